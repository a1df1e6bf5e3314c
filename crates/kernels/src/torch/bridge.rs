//! The functions of `bridge.cpp`.

use std::ffi::{CStr, c_char, c_void};
use std::ptr;

use tch::Tensor;

use crate::adam_w_step::AdamWStep;

#[repr(C)]
struct Opaque([u8; 0]);

unsafe extern "C" {
    fn torqued_free(message: *mut c_char);
    fn torqued_record(
        output: *const c_void,
        inputs: *const *const c_void,
        count: usize,
        recorded: *mut *mut Opaque,
    ) -> *mut c_char;
    fn torqued_differentiate(
        recorded: *mut Opaque,
        gradient: *const c_void,
        results: *mut *mut torch_sys::C_tensor,
    ) -> *mut c_char;
    fn torqued_forget(recorded: *mut Opaque);
    fn torqued_adam_w(
        count: usize,
        weights: *const *const c_void,
        gradients: *const *const c_void,
        first: *const *const c_void,
        second: *const *const c_void,
        time: f64,
        learning_rate: f64,
        beta_1: f64,
        beta_2: f64,
        weight_decay: f64,
        epsilon: f64,
        scale: f64,
        updated: *mut *mut torch_sys::C_tensor,
    ) -> *mut c_char;
    fn torqued_configure(is_tf32: bool) -> *mut c_char;
    fn torqued_torch_version() -> *const c_char;
    fn torqued_gpu(name: *mut c_char, size: i32, version: *mut i32) -> bool;
    fn torqued_peak_bytes(bytes: *mut i64) -> *mut c_char;
    fn torqued_seed(is_on_gpu: bool, seed: u64) -> *mut c_char;
    fn torqued_norm(count: usize, values: *const *const c_void, norm: *mut f64) -> *mut c_char;
}

/// Panics with the message of a C++ exception. A training ends with it, as with burn's own panics.
fn check(message: *mut c_char) {
    if message.is_null() {
        return;
    }
    // SAFETY: the bridge returns null or a string of C that ends with a zero.
    let text = unsafe { CStr::from_ptr(message) }.to_string_lossy().into_owned();
    // SAFETY: the bridge made the message, and nothing reads it any more.
    unsafe { torqued_free(message) };
    panic!("PyTorch: {text}");
}

fn pointers<'a>(tensors: impl IntoIterator<Item = &'a Tensor>) -> Vec<*const c_void> {
    tensors.into_iter().map(|tensor| tensor.as_ptr().cast()).collect()
}

/// The graph from inputs to an output, with the values that its derivative needs.
#[derive(Debug)]
pub struct Recorded {
    graph: *mut Opaque,
    inputs: usize,
}

// SAFETY: PyTorch's graphs may be used and dropped on any thread. Nothing changes one after it was recorded, except that its
// only use frees what it saved.
unsafe impl Send for Recorded {}
// SAFETY: as above.
unsafe impl Sync for Recorded {}

impl Recorded {
    /// Records the graph from `inputs` to `output`.
    pub fn new(output: &Tensor, inputs: &[Tensor]) -> Self {
        let (pointers, mut graph) = (pointers(inputs), ptr::null_mut());
        // SAFETY: all pointers are those of living tensors, and the count is their number.
        check(unsafe {
            torqued_record(output.as_ptr().cast(), pointers.as_ptr(), inputs.len(), &mut graph)
        });
        Self { graph, inputs: inputs.len() }
    }

    /// The gradient of each input, from the output's. It can be asked for once, because the graph then frees what it saved.
    pub fn differentiate(&self, gradient: &Tensor) -> Vec<Option<Tensor>> {
        let mut results = vec![ptr::null_mut(); self.inputs];
        // SAFETY: the graph lives, and there is a place for each input.
        check(unsafe {
            torqued_differentiate(self.graph, gradient.as_ptr().cast(), results.as_mut_ptr())
        });
        // SAFETY: the bridge made these tensors for the caller.
        let own = |result| unsafe { Tensor::from_ptr(result) };
        results.into_iter().map(|result| (!result.is_null()).then(|| own(result))).collect()
    }
}

impl Drop for Recorded {
    fn drop(&mut self) {
        // SAFETY: this is the only owner.
        unsafe { torqued_forget(self.graph) };
    }
}

/// The weights after a step of AdamW. `parameters` are weight, gradient and both moments of each. The moments change in place.
pub fn adam_w(parameters: &[[&Tensor; 4]], step: &AdamWStep) -> Vec<Tensor> {
    let column = |index: usize| pointers(parameters.iter().map(|parameter| parameter[index]));
    let [weights, gradients, first, second] = [0, 1, 2, 3].map(column);
    let mut updated = vec![ptr::null_mut(); weights.len()];
    // SAFETY: there are as many of each as of the weights, and all live.
    check(unsafe {
        torqued_adam_w(
            weights.len(),
            weights.as_ptr(),
            gradients.as_ptr(),
            first.as_ptr(),
            second.as_ptr(),
            step.time as f64,
            step.learning_rate,
            step.betas[0],
            step.betas[1],
            step.weight_decay,
            step.epsilon,
            step.scale,
            updated.as_mut_ptr(),
        )
    });
    // SAFETY: the bridge made these tensors for the caller.
    updated.into_iter().map(|tensor| unsafe { Tensor::from_ptr(tensor) }).collect()
}

/// The Euclidean norm over all numbers of `values`.
pub fn norm<'a>(values: impl IntoIterator<Item = &'a Tensor>) -> f64 {
    let (values, mut norm) = (pointers(values), 0.0);
    // SAFETY: all pointers are those of living tensors.
    check(unsafe { torqued_norm(values.len(), values.as_ptr(), &mut norm) });
    norm
}

/// Chooses how the process computes: whether products and convolutions round their factors to TF32.
pub fn configure(is_tf32: bool) {
    // SAFETY: the function only sets options of the process.
    check(unsafe { torqued_configure(is_tf32) });
}

/// PyTorch's version.
pub fn version() -> String {
    // SAFETY: the version is a constant of C.
    unsafe { CStr::from_ptr(torqued_torch_version()) }.to_string_lossy().into_owned()
}

/// The name of the first GPU, and the version of CUDA that its driver has, if there is a driver.
pub fn gpu() -> Option<(String, String)> {
    const SIZE: i32 = 256;
    let (mut name, mut version) = ([0; SIZE as usize], 0);
    // SAFETY: the name has `SIZE` bytes, the last of which stays zero.
    if !unsafe { torqued_gpu(name.as_mut_ptr(), SIZE - 1, &mut version) } {
        return None;
    }
    // SAFETY: the name ends with a zero.
    let name = unsafe { CStr::from_ptr(name.as_ptr()) }.to_string_lossy().into_owned();
    Some((name, format!("{}.{}", version / 1000, version % 1000 / 10)))
}

/// The most bytes that tensors of this process had on the GPU at once since the last call, or 0 without a GPU.
pub fn peak_bytes() -> u64 {
    let mut bytes = 0;
    // SAFETY: there is a place for the number.
    check(unsafe { torqued_peak_bytes(&mut bytes) });
    u64::try_from(bytes).unwrap_or(0)
}

/// Starts the random numbers of PyTorch anew.
pub fn seed(is_on_gpu: bool, seed: u64) {
    // SAFETY: the function only sets a generator of the process.
    check(unsafe { torqued_seed(is_on_gpu, seed) });
}
