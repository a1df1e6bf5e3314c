//! Parameters that a training does not change.

use burn::module::{ModuleMapper, Param};
use burn::tensor::Tensor;
use spec::SpecError;

use crate::ModelError;
use crate::parameters::{Path, for_each_parameter};
use crate::sequence_model::SequenceModel;

/// `model` without gradients of the parameters that `frozen` names by the beginnings of their
/// names, so that no step changes them.
///
/// # Errors
/// [`ModelError::Spec`] when an entry names no parameter, or no parameter is left to train.
pub(crate) fn freeze(model: SequenceModel, frozen: &[String]) -> Result<SequenceModel, ModelError> {
    if frozen.is_empty() {
        return Ok(model);
    }
    let mut names = Vec::new();
    for_each_parameter(&model, |name, _| names.push(name));
    for (i, prefix) in frozen.iter().enumerate() {
        if !names.iter().any(|name| begins_with(name, prefix)) {
            let allowed = format!("the beginning of a parameter's name: {}", names.join(", "));
            return Err(SpecError::one(format!("frozen[{i}]"), prefix.clone(), allowed).into());
        }
    }
    if names.iter().all(|name| is_frozen(name, frozen)) {
        let allowed = "some parameters left out, which are trained";
        return Err(SpecError::one("frozen", "all parameters", allowed).into());
    }
    Ok(model.map(&mut Freeze { path: Path::default(), frozen }))
}

fn is_frozen(name: &str, frozen: &[String]) -> bool {
    frozen.iter().any(|prefix| begins_with(name, prefix))
}

/// Whether `prefix` is the parameter's name, or ends at one of its dots.
fn begins_with(name: &str, prefix: &str) -> bool {
    name.strip_prefix(prefix).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
}

struct Freeze<'a> {
    path: Path,
    frozen: &'a [String],
}

impl ModuleMapper for Freeze<'_> {
    fn enter_module(&mut self, name: &str, _container: &str) {
        self.path.enter(name);
    }

    fn exit_module(&mut self, _name: &str, _container: &str) {
        self.path.leave();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        if is_frozen(&self.path.name(), self.frozen) {
            param.map(|value| Tensor::from_inner(value.inner())).set_require_grad(false)
        } else {
            param
        }
    }
}

#[cfg(test)]
mod tests {
    use super::begins_with;

    #[test]
    fn a_beginning_ends_at_a_dot_or_at_the_end() {
        for (prefix, is_found) in [
            ("blocks", true),
            ("blocks.1", true),
            ("blocks.1.norm.gamma", true),
            ("blocks.1.no", false),
            ("block", false),
            ("", false),
        ] {
            assert_eq!(begins_with("blocks.1.norm.gamma", prefix), is_found, "{prefix}");
        }
    }
}
