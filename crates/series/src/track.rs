use std::ops::Index;

/// u or y of one robot, `[sample, joint]`. `track[k][j]` is the value of joint j at sample k.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Track<'a> {
    values: &'a [f32],
    joints: usize,
}

impl<'a> Track<'a> {
    /// The `values` `[sample, joint]` of one robot.
    pub fn new(values: &'a [f32], joints: usize) -> Self {
        Self { values, joints }
    }

    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.values.len() / self.joints.max(1)
    }

    /// Values of each sample, one per joint.
    pub fn joints(&self) -> usize {
        self.joints
    }

    /// The values of each sample, in order.
    pub fn iter(&self) -> std::slice::ChunksExact<'a, f32> {
        self.values.chunks_exact(self.joints.max(1))
    }

    /// The values of joint `joint`, in order.
    pub fn joint(&self, joint: usize) -> impl DoubleEndedIterator<Item = f32> + use<'a> {
        self.iter().map(move |sample| sample[joint])
    }

    /// `[sample, joint]`.
    pub fn values(&self) -> &'a [f32] {
        self.values
    }
}

impl Index<usize> for Track<'_> {
    type Output = [f32];

    fn index(&self, sample: usize) -> &[f32] {
        &self.values[sample * self.joints..][..self.joints]
    }
}

impl<'a> IntoIterator for Track<'a> {
    type Item = &'a [f32];
    type IntoIter = std::slice::ChunksExact<'a, f32>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}
