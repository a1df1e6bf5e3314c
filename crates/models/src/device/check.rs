//! A first computation that finds a broken device before work begins.

use burn::tensor::{Tensor, TensorData};

use super::{Device, DeviceError, DeviceKind};
use crate::device::host_values;

/// Extents of the matrices: more than one tile of any GPU, and no multiple of one.
const ROWS: usize = 70;
const INNER: usize = 37;
const COLUMNS: usize = 19;

/// Largest error that float32 sums of [`INNER`] or [`ROWS`] terms of about 1 can have.
const TOLERANCE: f64 = 1e-4;

/// The same of factors that were rounded to TF32, which keeps eleven bits.
const TOLERANCE_OF_TF32: f64 = 2e-2;

impl Device {
    /// Computes the mean of (X W)² and its gradient by W, and compares both with sums made here.
    /// This runs a matrix product, a reduction and a backward pass.
    ///
    /// # Errors
    /// Results that cannot be read back or are wrong. Some drivers panic, crash or hang instead.
    pub fn check(&self) -> Result<(), DeviceError> {
        let x: Vec<f32> = (0..ROWS * INNER).map(|i| wave(i, 0.7)).collect();
        let w: Vec<f32> = (0..INNER * COLUMNS).map(|i| wave(i, 1.3)).collect();

        let device = self.training();
        let on_device = |values: &[f32], shape| {
            Tensor::<2>::from_data(TensorData::new(values.to_vec(), shape), &device)
        };
        let weight = on_device(&w, [INNER, COLUMNS]).require_grad();
        let mean = on_device(&x, [ROWS, INNER]).matmul(weight.clone()).square().mean();
        let gradient = weight.grad(&mean.backward());
        let read = |values: Result<Vec<f32>, crate::ModelError>| {
            values.map_err(|error| DeviceError::Unavailable {
                kind: self.kind,
                reason: error.to_string(),
            })
        };
        let found_mean = read(host_values(mean.inner()))?;
        let found_gradient = gradient.map(host_values).map_or(Ok(Vec::new()), read)?;

        let (mean, gradient) = expected(&x, &w);
        self.compare("a mean of squares", &found_mean, &[mean])?;
        self.compare("a gradient", &found_gradient, &gradient)
    }

    fn compare(
        &self,
        what: &'static str,
        found: &[f32],
        expected: &[f64],
    ) -> Result<(), DeviceError> {
        let wrong = |found: String, expected: String| {
            Err(DeviceError::Wrong { kind: self.kind, what, found, expected })
        };
        if found.len() != expected.len() {
            return wrong(format!("{} values", found.len()), format!("{} values", expected.len()));
        }
        let tolerance = match self.kind {
            DeviceKind::TorchTf32 => TOLERANCE_OF_TF32,
            _ => TOLERANCE,
        };
        for (&found, &expected) in found.iter().zip(expected) {
            // NaN and infinity are not close.
            let is_close = (f64::from(found) - expected).abs() <= tolerance;
            if !is_close {
                return wrong(found.to_string(), expected.to_string());
            }
        }
        Ok(())
    }
}

/// Values without a pattern, so that a wrong stride changes the result.
#[expect(clippy::cast_possible_truncation, reason = "float32 is what devices compute in")]
fn wave(index: usize, frequency: f64) -> f32 {
    (frequency * index as f64).sin() as f32
}

/// Σ (X W)² / (rows columns), and 2 Xᵀ X W / (rows columns), row-major.
fn expected(x: &[f32], w: &[f32]) -> (f64, Vec<f64>) {
    let scale = 1.0 / (ROWS * COLUMNS) as f64;
    let mut mean = 0.0;
    let mut gradient = vec![0.0; INNER * COLUMNS];
    for row in x.chunks_exact(INNER) {
        for column in 0..COLUMNS {
            let terms = row.iter().zip(w.iter().skip(column).step_by(COLUMNS));
            let product: f64 = terms.map(|(&x, &w)| f64::from(x) * f64::from(w)).sum();
            mean += scale * product * product;
            for (inner, &x) in row.iter().enumerate() {
                gradient[inner * COLUMNS + column] += scale * 2.0 * f64::from(x) * product;
            }
        }
    }
    (mean, gradient)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_processor_passes_the_check() {
        Device::cpu().check().unwrap();
    }

    #[test]
    fn a_result_that_is_off_or_missing_is_named() {
        let device = Device::cpu();
        let message = device.compare("a gradient", &[1.0, f32::NAN], &[1.0, 2.0]).unwrap_err();
        assert_eq!(
            message.to_string(),
            "device `cpu` computes wrongly: a gradient is NaN, expected 2"
        );
        assert!(device.compare("a gradient", &[1.0, 2.01], &[1.0, 2.0]).is_err());
        assert!(device.compare("a gradient", &[], &[1.0]).is_err());
        assert!(device.compare("a gradient", &[1.0], &[1.0]).is_ok());
    }
}
