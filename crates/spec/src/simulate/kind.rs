//! A simulation as a kind of job.

use serde_json::{Map, Value};

use super::completion::complete;
use super::spec::SimulateSpec;
use crate::doubt::Doubt;
use crate::kind::{KindSpec, from_fields};
use crate::schema::Components;
use crate::{DataSpec, Execution, Product, SpecError};

impl KindSpec for SimulateSpec {
    fn read(
        mut fields: Map<String, Value>,
        mut found: SpecError,
        schemas: &Components,
    ) -> Result<Self, SpecError> {
        if let Err(error) = complete(&mut fields, schemas) {
            found.append(error);
        }
        from_fields(fields, found, schemas)
    }

    fn makes() -> Option<Product> {
        Some(Product::Trajectories)
    }

    fn execution(&self) -> Execution {
        self.execution.clone()
    }

    fn data(&self) -> Option<DataSpec> {
        Some(DataSpec::Simulation(self.clone()))
    }

    fn doubts(&self) -> Vec<Doubt> {
        Self::doubts(self)
    }
}
