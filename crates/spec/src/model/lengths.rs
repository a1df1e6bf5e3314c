/// The contexts and horizons that one training supports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lengths {
    /// The lengths that it was trained with.
    Trained,
    /// Contexts from this many samples up to the trained one, and horizons up to the end of the
    /// training's trajectories. All must be multiples of the patch.
    From(u32),
    /// Any length, because a model that integrates equations does not depend on it.
    Any,
}

/// Number of samples of a context, and of context and horizon together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Length {
    /// Number of samples of the context.
    pub context: u32,
    /// Number of samples of context and horizon.
    pub samples: u32,
}

impl Lengths {
    /// One sample with a neighbour on each side.
    const LEAST_CONTEXT: u32 = 3;

    /// The supported length nearest to `asked`. The training has `trained` samples and tokens of
    /// `patch` samples.
    #[must_use]
    pub fn nearest(self, asked: Length, trained: Length, patch: u32) -> Length {
        match self {
            Self::Trained => trained,
            Self::From(least) => {
                let whole = |samples: u32| samples - samples % patch;
                let context = whole(asked.context.max(least).min(trained.context));
                let horizon = asked.samples.min(trained.samples).saturating_sub(context);
                Length { context, samples: context + whole(horizon).max(patch) }
            }
            Self::Any => {
                let context = asked.context.max(Self::LEAST_CONTEXT);
                Length { context, samples: asked.samples }
            }
        }
    }

    /// How many times the rate of its training a model with these lengths is asked at, if it can
    /// answer: 1, or any whole number for a model that integrates equations.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a ratio of rates, at least 1 and below 1e6"
    )]
    pub fn multiple(self, trained_hz: f64, asked_hz: f64) -> Option<usize> {
        let ratio = asked_hz / trained_hz;
        let most = if self == Self::Any { 1e6 } else { 1.0 };
        let whole = ratio.round();
        let is_whole = (ratio - whole).abs() <= 1e-9 * whole && (1.0..=most).contains(&whole);
        is_whole.then_some(whole as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::{Length, Lengths};

    const TRAINED: Length = Length { context: 320, samples: 400 };

    fn answers(lengths: Lengths, context: u32, samples: u32) -> bool {
        let asked = Length { context, samples };
        lengths.nearest(asked, TRAINED, 5) == asked
    }

    #[test]
    fn a_training_answers_its_own_lengths_those_it_was_cut_to_or_any() {
        for lengths in [Lengths::Trained, Lengths::From(20), Lengths::Any] {
            assert!(answers(lengths, 320, 400), "{lengths:?}");
        }
        assert!(!answers(Lengths::Trained, 320, 390) && !answers(Lengths::Trained, 20, 100));
        for (context, samples) in [(20, 25), (20, 400), (160, 240), (315, 320)] {
            assert!(answers(Lengths::From(20), context, samples), "{context}, {samples}");
        }
        for (context, samples) in [(15, 95), (21, 101), (20, 99), (320, 405), (325, 400), (20, 20)]
        {
            assert!(!answers(Lengths::From(20), context, samples), "{context}, {samples}");
        }
        assert!(answers(Lengths::Any, 3, 9999) && !answers(Lengths::Any, 2, 9999));
    }
}
