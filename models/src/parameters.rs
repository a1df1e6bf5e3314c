//! Parameters by name: the way between a model and files.

use std::collections::BTreeMap;

use burn::module::{ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Tensor, TensorData};

use crate::ModelError;
use crate::device::host_values;
use crate::sequence_model::SequenceModel;

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct NamedTensor {
    pub shape: Vec<usize>,
    pub values: Vec<f32>,
}

/// By the path of the parameter in its module, such as `encoder_blocks.0.attention.query.weight`.
pub(crate) type NamedTensors = BTreeMap<String, NamedTensor>;

/// A copy of every parameter.
pub(crate) fn parameters(model: &SequenceModel) -> Result<NamedTensors, ModelError> {
    let mut reader = Reader { path: Path::default(), tensors: Ok(NamedTensors::new()) };
    model.visit(&mut reader);
    reader.tensors
}

/// The model with every parameter replaced by the tensor of its name.
///
/// # Errors
/// What is missing, superfluous or of another shape.
pub(crate) fn with_parameters(
    model: SequenceModel,
    tensors: NamedTensors,
) -> Result<SequenceModel, String> {
    check_shapes(&model, &tensors)?;
    let mut writer = Writer { path: Path::default(), tensors };
    Ok(model.map(&mut writer))
}

/// Whether `tensors` has exactly the names and shapes of the model's parameters.
pub(crate) fn check_shapes(model: &SequenceModel, tensors: &NamedTensors) -> Result<(), String> {
    let mut shapes = Shapes::default();
    model.visit(&mut shapes);
    for (name, shape) in &shapes.found {
        match tensors.get(name) {
            None => return Err(format!("tensor `{name}` is missing")),
            Some(tensor) if tensor.shape != *shape => {
                let found = &tensor.shape;
                return Err(format!("tensor `{name}` has shape {found:?}, expected {shape:?}"));
            }
            Some(_) => {}
        }
    }
    match tensors.keys().find(|name| !shapes.found.contains_key(*name)) {
        Some(name) => Err(format!("tensor `{name}` is no parameter of this model")),
        None => Ok(()),
    }
}

/// Where a walk over a module is.
#[derive(Default)]
pub(crate) struct Path(Vec<String>);

impl Path {
    pub fn enter(&mut self, name: &str) {
        self.0.push(name.to_owned());
    }

    pub fn leave(&mut self) {
        self.0.pop();
    }

    pub fn name(&self) -> String {
        self.0.join(".")
    }
}

struct Reader {
    path: Path,
    tensors: Result<NamedTensors, ModelError>,
}

impl ModuleVisitor for Reader {
    fn enter_module(&mut self, name: &str, _container: &str) {
        self.path.enter(name);
    }

    fn exit_module(&mut self, _name: &str, _container: &str) {
        self.path.leave();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let Ok(tensors) = &mut self.tensors else { return };
        let tensor = param.val().inner();
        let shape = tensor.dims().to_vec();
        match host_values(tensor) {
            Ok(values) => {
                tensors.insert(self.path.name(), NamedTensor { shape, values });
            }
            Err(error) => self.tensors = Err(error),
        }
    }
}

#[derive(Default)]
struct Shapes {
    path: Path,
    found: BTreeMap<String, Vec<usize>>,
}

impl ModuleVisitor for Shapes {
    fn enter_module(&mut self, name: &str, _container: &str) {
        self.path.enter(name);
    }

    fn exit_module(&mut self, _name: &str, _container: &str) {
        self.path.leave();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.found.insert(self.path.name(), param.lazy_shape().to_vec());
    }
}

struct Writer {
    path: Path,
    tensors: NamedTensors,
}

impl ModuleMapper for Writer {
    fn enter_module(&mut self, name: &str, _container: &str) {
        self.path.enter(name);
    }

    fn exit_module(&mut self, _name: &str, _container: &str) {
        self.path.leave();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        match self.tensors.remove(&self.path.name()) {
            Some(NamedTensor { shape, values }) => {
                let device = param.lazy_device();
                Param::from_data(TensorData::new(values, shape), &device)
            }
            None => param,
        }
    }
}
