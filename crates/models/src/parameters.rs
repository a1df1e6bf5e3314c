//! Parameters by name, between a model and its files.

use std::collections::BTreeMap;

use burn::module::{ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Gradients, Tensor, TensorData};

use crate::ModelError;
use crate::device::host_values;
use crate::sequence_model::SequenceModel;

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct NamedTensor {
    pub shape: Vec<usize>,
    pub values: Vec<f32>,
}

/// Tensors by the path of the parameter in its module, such as
/// `encoder_blocks.0.attention.query.weight`.
pub(crate) type NamedTensors = BTreeMap<String, NamedTensor>;

/// A parameter, whatever its rank.
pub(crate) trait Parameter {
    fn shape(&self) -> Vec<usize>;

    /// Its values as a flat tensor.
    fn numbers(&self) -> Tensor<1>;

    /// Its gradient as a flat tensor, which is taken out of `gradients`.
    fn gradient(&self, gradients: &mut Gradients) -> Option<Tensor<1>>;
}

impl<const D: usize> Parameter for Param<Tensor<D>> {
    fn shape(&self) -> Vec<usize> {
        self.lazy_shape().to_vec()
    }

    fn numbers(&self) -> Tensor<1> {
        in_a_row(self.val().inner())
    }

    fn gradient(&self, gradients: &mut Gradients) -> Option<Tensor<1>> {
        self.val().grad_remove(gradients).map(in_a_row)
    }
}

fn in_a_row<const D: usize>(tensor: Tensor<D>) -> Tensor<1> {
    let length = tensor.shape().num_elements();
    tensor.reshape([length])
}

/// Calls `visit` with the name of every parameter and the parameter.
pub(crate) fn for_each_parameter(model: &SequenceModel, visit: impl FnMut(String, &dyn Parameter)) {
    model.visit(&mut Walk { path: Path::default(), visit });
}

/// A copy of every parameter.
pub(crate) fn parameters(model: &SequenceModel) -> Result<NamedTensors, ModelError> {
    let mut tensors = Ok(NamedTensors::new());
    for_each_parameter(model, |name, parameter| {
        let Ok(copied) = &mut tensors else { return };
        match host_values(parameter.numbers()) {
            Ok(values) => {
                copied.insert(name, NamedTensor { shape: parameter.shape(), values });
            }
            Err(error) => tensors = Err(error),
        }
    });
    tensors
}

/// The model with every parameter replaced by the tensor of its name.
///
/// # Errors
/// A tensor is missing, superfluous or of another shape.
pub(crate) fn with_parameters(
    model: SequenceModel,
    tensors: NamedTensors,
) -> Result<SequenceModel, String> {
    check_shapes(&model, &tensors)?;
    let mut writer = Writer { path: Path::default(), tensors };
    Ok(model.map(&mut writer))
}

/// Checks that `tensors` has exactly the names and shapes of the model's parameters.
pub(crate) fn check_shapes(model: &SequenceModel, tensors: &NamedTensors) -> Result<(), String> {
    let mut shapes = BTreeMap::new();
    for_each_parameter(model, |name, parameter| {
        shapes.insert(name, parameter.shape());
    });
    for (name, shape) in &shapes {
        match tensors.get(name) {
            None => return Err(format!("tensor `{name}` is missing")),
            Some(tensor) if tensor.shape != *shape => {
                let found = &tensor.shape;
                return Err(format!("tensor `{name}` has shape {found:?}, expected {shape:?}"));
            }
            Some(_) => {}
        }
    }
    match tensors.keys().find(|name| !shapes.contains_key(*name)) {
        Some(name) => Err(format!("tensor `{name}` is not a parameter of this model")),
        None => Ok(()),
    }
}

/// The current place in a walk over a module.
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

struct Walk<V> {
    path: Path,
    visit: V,
}

impl<V: FnMut(String, &dyn Parameter)> ModuleVisitor for Walk<V> {
    fn enter_module(&mut self, name: &str, _container: &str) {
        self.path.enter(name);
    }

    fn exit_module(&mut self, _name: &str, _container: &str) {
        self.path.leave();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        (self.visit)(self.path.name(), param);
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
