//! Tensors in the bytes of a safetensors file.

use std::borrow::Cow;
use std::collections::HashMap;

use safetensors::tensor::{Dtype, View};
use safetensors::{SafeTensors, serialize};

use crate::ModelError;
use crate::parameters::{NamedTensor, NamedTensors};

/// Little-endian float32, the only type written or read.
struct FloatView<'a> {
    shape: &'a [usize],
    bytes: Vec<u8>,
}

impl View for FloatView<'_> {
    fn dtype(&self) -> Dtype {
        Dtype::F32
    }

    fn shape(&self) -> &[usize] {
        self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        Cow::Borrowed(&self.bytes)
    }

    fn data_len(&self) -> usize {
        self.bytes.len()
    }
}

/// Encodes tensors as safetensors. The same tensors give the same bytes.
pub(crate) fn encode(file: &'static str, tensors: &NamedTensors) -> Result<Vec<u8>, ModelError> {
    for (name, tensor) in tensors {
        if let Some(&value) = tensor.values.iter().find(|value| !value.is_finite()) {
            return Err(ModelError::NotFiniteTensor { file, tensor: name.clone(), value });
        }
    }
    let views = tensors.iter().map(|(name, tensor)| {
        let bytes = tensor.values.iter().flat_map(|value| value.to_le_bytes()).collect();
        (name, FloatView { shape: &tensor.shape, bytes })
    });
    // Loaders of PyTorch checkpoints look for this entry. It is the only one, because several
    // entries would be written in the order of a hash map, which differs in every process.
    let metadata = HashMap::from([("format".to_owned(), "pt".to_owned())]);
    serialize(views, Some(metadata))
        .map_err(|error| ModelError::CheckpointFile { file, reason: error.to_string() })
}

pub(crate) fn decode(file: &'static str, bytes: &[u8]) -> Result<NamedTensors, ModelError> {
    let damaged = |reason| ModelError::CheckpointFile { file, reason };
    let parsed = SafeTensors::deserialize(bytes)
        .map_err(|error| damaged(format!("is not a safetensors file: {error}")))?;
    let mut tensors = NamedTensors::new();
    for (name, view) in parsed.iter() {
        if view.dtype() != Dtype::F32 {
            let found = view.dtype();
            return Err(damaged(format!("tensor `{name}` is of type {found:?}, expected F32")));
        }
        let (numbers, _) = view.data().as_chunks::<4>();
        let values: Vec<f32> = numbers.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
        if let Some(value) = values.iter().find(|value| !value.is_finite()) {
            return Err(damaged(format!("tensor `{name}` has {value}, expected finite values")));
        }
        tensors.insert(name.to_owned(), NamedTensor { shape: view.shape().to_vec(), values });
    }
    Ok(tensors)
}
