//! One value per joint, and the state of all joints.

use std::fmt;
use std::ops::{Deref, DerefMut};

use serde::{Serialize, Serializer};
use spec::MAX_JOINTS;

/// One value per joint of an arm, at most [`MAX_JOINTS`], stored in place. It derefs to a slice.
#[derive(Clone, Copy)]
pub struct Joints<T> {
    values: [T; MAX_JOINTS],
    count: usize,
}

/// Positions and velocities of an arm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ArmState {
    /// Positions, rad.
    pub q: Joints<f64>,
    /// Velocities, rad/s.
    pub qd: Joints<f64>,
}

impl<T: Copy + Default> Joints<T> {
    /// # Panics
    /// If `count` is larger than [`MAX_JOINTS`]. The same holds for all constructors.
    pub fn from_fn(count: usize, value: impl FnMut(usize) -> T) -> Self {
        (0..count).map(value).collect()
    }

    /// The same value for each of `count` joints.
    pub fn splat(count: usize, value: T) -> Self {
        Self::from_fn(count, |_| value)
    }

    /// The first `count` of `values`. The others have to be 0.
    #[inline(always)]
    pub(crate) fn from_padded(count: usize, values: [T; MAX_JOINTS]) -> Self {
        Self { values, count }
    }

    /// The values, and zeros up to [`MAX_JOINTS`]. Loops over them have a constant length.
    #[inline(always)]
    pub(crate) fn padded(&self) -> &[T; MAX_JOINTS] {
        &self.values
    }

    /// Applies `change` to every value.
    #[must_use]
    pub fn map<U: Copy + Default>(&self, change: impl FnMut(T) -> U) -> Joints<U> {
        self.iter().copied().map(change).collect()
    }
}

impl<T: Copy + Default> FromIterator<T> for Joints<T> {
    fn from_iter<I: IntoIterator<Item = T>>(values: I) -> Self {
        let mut joints = Self::default();
        for value in values {
            assert!(joints.count < MAX_JOINTS, "an arm has at most {MAX_JOINTS} joints");
            joints.values[joints.count] = value;
            joints.count += 1;
        }
        joints
    }
}

impl<T: Copy + Default> Default for Joints<T> {
    /// No joints.
    fn default() -> Self {
        Self { values: [T::default(); MAX_JOINTS], count: 0 }
    }
}

impl<T: Copy + Default> From<&[T]> for Joints<T> {
    fn from(values: &[T]) -> Self {
        values.iter().copied().collect()
    }
}

impl<T: Copy + Default, const N: usize> From<[T; N]> for Joints<T> {
    fn from(values: [T; N]) -> Self {
        values.into_iter().collect()
    }
}

impl<T> Deref for Joints<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.values[..self.count]
    }
}

impl<T> DerefMut for Joints<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.values[..self.count]
    }
}

impl<T: PartialEq> PartialEq for Joints<T> {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

/// A list with one value per joint.
impl<T: Serialize> Serialize for Joints<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.iter())
    }
}

impl<T: fmt::Debug> fmt::Debug for Joints<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}

impl<'a, T> IntoIterator for &'a Joints<T> {
    type Item = &'a T;
    type IntoIter = std::slice::Iter<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}
