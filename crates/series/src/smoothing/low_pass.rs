//! A zero-phase low-pass.

use std::f64::consts::PI;

/// Butterworth low-pass of order 4, run forwards and backwards. So nothing is shifted in time, and
/// the order is 8 in effect, with half the amplitude at the edge.
///
/// Series are extended at both ends by their own odd reflections, as in `scipy.signal.filtfilt`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LowPass {
    sections: [Section; 2],
}

/// Second-order section b0 (1 + z⁻¹)² / (1 + a1 z⁻¹ + a2 z⁻²) with unit gain at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Section {
    b0: f64,
    a1: f64,
    a2: f64,
}

/// Samples of reflection at each end: three times the number of the filter's coefficients.
const REFLECTED: usize = 15;

impl LowPass {
    /// A filter at `edge_hz`. `None` unless 0 < `edge_hz` < `rate_hz` / 2.
    pub fn new(edge_hz: f64, rate_hz: f64) -> Option<Self> {
        if !(edge_hz > 0.0 && edge_hz < 0.5 * rate_hz) {
            return None;
        }
        // The bilinear transform, with its warping of the edge undone.
        let edge = (PI * edge_hz / rate_hz).tan();
        // Twice the damping ratio of each pair of poles.
        let sections = [1.0, 3.0].map(|k| {
            let damping = 2.0 * (k * PI / 8.0).cos();
            let scale = 1.0 / (1.0 + damping * edge + edge * edge);
            Section {
                b0: edge * edge * scale,
                a1: 2.0 * (edge * edge - 1.0) * scale,
                a2: (1.0 - damping * edge + edge * edge) * scale,
            }
        });
        Some(Self { sections })
    }

    /// The filtered series. `None` if it is not longer than the reflection.
    pub fn apply(&self, series: &[f64]) -> Option<Vec<f64>> {
        let (first, last) = (*series.first()?, *series.last()?);
        if series.len() <= REFLECTED {
            return None;
        }
        let before = series[1..=REFLECTED].iter().rev().map(|x| 2.0 * first - x);
        let after = series.iter().rev().skip(1).take(REFLECTED).map(|x| 2.0 * last - x);
        let mut extended: Vec<f64> = before.chain(series.iter().copied()).chain(after).collect();
        for _ in 0..2 {
            self.forwards(&mut extended);
            extended.reverse();
        }
        Some(extended[REFLECTED..REFLECTED + series.len()].to_vec())
    }

    /// Filters each column of `rows`, `[sample][column]`. Columns that are not longer than the
    /// reflection stay as they are.
    pub fn apply_to_columns(&self, rows: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let columns = rows.first().map_or(0, Vec::len);
        let columns: Vec<Vec<f64>> = (0..columns)
            .map(|column| {
                let values: Vec<f64> = rows.iter().map(|row| row[column]).collect();
                self.apply(&values).unwrap_or(values)
            })
            .collect();
        (0..rows.len()).map(|k| columns.iter().map(|column| column[k]).collect()).collect()
    }

    /// Filters forwards, as if the first value had been there for ever.
    fn forwards(&self, series: &mut [f64]) {
        for Section { b0, a1, a2 } in self.sections {
            let Some(&first) = series.first() else { return };
            // State of the transposed direct form II at rest, with input and output 1.
            let (mut late, mut later) = ((1.0 - b0) * first, (b0 - a2) * first);
            for x in series.iter_mut() {
                let y = b0 * *x + late;
                late = 2.0 * b0 * *x - a1 * y + later;
                later = b0 * *x - a2 * y;
                *x = y;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Deserialize)]
    struct Reference {
        series: Vec<f64>,
        filtered: Vec<Filtered>,
    }

    #[derive(Deserialize)]
    struct Filtered {
        edge_hz: f64,
        rate_hz: f64,
        values: Vec<f64>,
    }

    #[test]
    fn it_filters_as_scipy_does() {
        let reference: Reference =
            serde_json::from_str(include_str!("../../tests/data/filtfilt.json")).unwrap();
        assert_eq!(reference.filtered.len(), 4);
        for Filtered { edge_hz, rate_hz, values } in reference.filtered {
            let ours = LowPass::new(edge_hz, rate_hz).unwrap().apply(&reference.series).unwrap();
            assert_eq!(ours.len(), values.len());
            for (k, (ours, theirs)) in ours.iter().zip(&values).enumerate() {
                assert!((ours - theirs).abs() < 1e-10, "{edge_hz} Hz, {k}: {ours} {theirs}");
            }
        }
    }

    #[test]
    fn a_constant_passes_unchanged_and_time_runs_both_ways() {
        let filter = LowPass::new(4.0, 60.0).unwrap();
        assert!(filter.apply(&[0.7; 80]).unwrap().iter().all(|x| (x - 0.7).abs() < 1e-12));
        let mut series: Vec<f64> = (0..80).map(|k| (0.01 * f64::from(k * k)).sin()).collect();
        let filtered = filter.apply(&series).unwrap();
        series.reverse();
        let mut backwards = filter.apply(&series).unwrap();
        backwards.reverse();
        // Both orders differ only by their transients at the beginning.
        for (a, b) in filtered[25..55].iter().zip(&backwards[25..55]) {
            assert!((a - b).abs() < 1e-3, "{a} {b}");
        }
    }

    #[test]
    fn an_edge_beyond_nyquist_and_a_series_too_short_have_no_filter() {
        for edge in [0.0, -1.0, 30.0, f64::NAN] {
            assert_eq!(LowPass::new(edge, 60.0), None);
        }
        let filter = LowPass::new(4.0, 60.0).unwrap();
        assert_eq!(filter.apply(&[]), None);
        assert_eq!(filter.apply(&[1.0; REFLECTED]), None);
        assert!(filter.apply(&[1.0; REFLECTED + 1]).is_some());
        let rows = vec![vec![1.0, -2.0]; REFLECTED];
        assert_eq!(filter.apply_to_columns(&rows), rows);
    }
}
