//! The newest predictions of stored trajectories. To look at one again computes nothing.

use std::sync::{Arc, Mutex, PoisonError};

use hashlink::LruCache;
use spec::Digest;
use wire::TrajectoryPrediction;

use crate::limits::{REMEMBERED_POSITIONS, REMEMBERED_PREDICTIONS};

/// A question about a stored trajectory. Equal questions have equal predictions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PredictionKey {
    /// The digest of the dataset.
    pub dataset: Digest,
    pub trajectory: u64,
    /// The digest of the checkpoint's weights.
    pub weights: Digest,
    pub begin: usize,
    pub samples: Option<u32>,
    pub steps: Option<u32>,
    pub seed: u64,
}

/// Those asked for last. Clones share them.
#[derive(Clone)]
pub struct RememberedPredictions(Arc<Mutex<LruCache<PredictionKey, TrajectoryPrediction>>>);

impl RememberedPredictions {
    pub fn new() -> Self {
        Self(Arc::new(Mutex::new(LruCache::new(REMEMBERED_PREDICTIONS))))
    }

    pub fn get(&self, key: &PredictionKey) -> Option<TrajectoryPrediction> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get(key).cloned()
    }

    /// Remembers a prediction, and forgets those not asked for longest when they are too many.
    pub fn insert(&self, key: PredictionKey, prediction: TrajectoryPrediction) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.insert(key, prediction);
        while all.iter().map(|(_, prediction)| positions(prediction)).sum::<usize>()
            > REMEMBERED_POSITIONS
        {
            all.remove_lru();
        }
    }
}

/// Positions in an answer, of all steps and joints.
fn positions(prediction: &TrajectoryPrediction) -> usize {
    let each = prediction.y.len() * prediction.joint_rmse_deg.len();
    each * (1 + prediction.quantiles.len() + prediction.samples.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(trajectory: u64) -> PredictionKey {
        let digest = Digest::of(b"some bytes");
        PredictionKey {
            dataset: digest,
            trajectory,
            weights: digest,
            begin: 40,
            samples: None,
            steps: None,
            seed: 0,
        }
    }

    fn prediction(steps: usize) -> TrajectoryPrediction {
        TrajectoryPrediction {
            y: vec![vec![0.0; 2]; steps],
            joint_rmse_deg: vec![0.0; 2],
            ..TrajectoryPrediction::default()
        }
    }

    #[test]
    fn the_newest_are_remembered_up_to_their_number_and_their_size() {
        let remembered = RememberedPredictions::new();
        for trajectory in 0..=REMEMBERED_PREDICTIONS as u64 {
            remembered.insert(key(trajectory), prediction(3));
            // It is asked for again each time.
            assert_eq!(remembered.get(&key(0)), Some(prediction(3)));
        }
        assert_eq!(remembered.get(&key(1)), None);
        assert_eq!(remembered.get(&PredictionKey { seed: 1, ..key(0) }), None);
        remembered.insert(key(1), prediction(REMEMBERED_POSITIONS / 2));
        assert_eq!(remembered.get(&key(2)), None);
        assert!(remembered.get(&key(1)).is_some());
        // One that is too large is not kept.
        remembered.insert(key(2), prediction(REMEMBERED_POSITIONS));
        assert_eq!(remembered.get(&key(2)), None);
    }
}
