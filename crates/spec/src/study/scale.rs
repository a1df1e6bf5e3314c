//! The scales of the studies.

/// The sizes of the study.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StudyScale {
    /// All kinds of jobs, in twenty minutes on two cores. Too small for conclusions.
    Tiny,
    /// Tiny models, trained long enough to compare them, in some hours on two cores.
    Small,
    /// The paper's sizes.
    Paper,
}

impl StudyScale {
    /// All scales, the smallest first.
    pub const ALL: [Self; 3] = [Self::Tiny, Self::Small, Self::Paper];

    /// The name on the command line.
    pub const fn name(self) -> &'static str {
        self.pick(["tiny", "small", "paper"])
    }

    /// The name of the preset.
    pub const fn preset(self) -> &'static str {
        self.pick(["paper-study-tiny", "paper-study-small", "paper-study"])
    }

    pub(super) const fn about(self) -> &'static str {
        self.pick([
            "The paper's study in twenty minutes: every kind of its jobs, too small to conclude from",
            "The paper's study with tiny models and several seeds, in some hours on two cores",
            "The paper's study at its own sizes, with several seeds",
        ])
    }

    pub(super) const fn index(self) -> usize {
        self.pick([0, 1, 2])
    }

    /// One of three values, for tiny, small and paper.
    pub(super) const fn pick<T: Copy>(self, [tiny, small, paper]: [T; 3]) -> T {
        match self {
            Self::Tiny => tiny,
            Self::Small => small,
            Self::Paper => paper,
        }
    }

    /// Number of training sets, beginning with D1.
    pub(super) const fn sets(self) -> usize {
        self.pick([2, 4, 4])
    }

    /// The largest number of seeds of a training.
    pub(super) const fn seeds(self) -> u64 {
        self.pick([3, 5, 5])
    }

    /// Optimizer steps of a training without a factor of its own.
    pub(super) const fn steps(self) -> u64 {
        self.pick([100, 2500, 54_688])
    }

    /// Number of robots in each cell of a sweep.
    pub(super) const fn robots(self) -> u64 {
        self.pick([4, 50, 100])
    }

    /// Number of robots in each of the four cells of samples and warm starts.
    pub(super) const fn sampled_robots(self) -> u64 {
        self.pick([4, 16, 100])
    }

    /// Contexts besides 320 samples, with a horizon of 80.
    pub(super) const fn contexts(self) -> &'static [u32] {
        self.pick([&[20], &[20, 40, 80, 160], &[20, 40, 80, 160]])
    }

    /// Horizons besides 80 samples, with a context of 320.
    pub(super) const fn horizons(self) -> &'static [u32] {
        self.pick([&[320], &[20, 160, 320], &[20, 160, 320]])
    }
}
