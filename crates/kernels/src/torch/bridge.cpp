// Functions of PyTorch's libraries that the crate `tch` does not bind. One that can fail returns null if it did not, and else a
// message that `torqued_free` frees.

#include <ATen/ATen.h>
#include <ATen/Context.h>
#include <ATen/DeviceAccelerator.h>
#include <torch/csrc/autograd/edge.h>
#include <torch/csrc/autograd/function.h>
#include <torch/csrc/autograd/variable.h>
#include <torch/version.h>

#include <dlfcn.h>

#include <cstdlib>
#include <cstring>
#include <exception>
#include <memory>
#include <mutex>
#include <unordered_map>
#include <vector>

using at::Tensor;
using torch::autograd::Edge;
using torch::autograd::Node;
using torch::autograd::variable_list;

namespace {

template <typename Action>
char *attempt(Action action) {
  try {
    action();
    return nullptr;
  } catch (const std::exception &error) {
    return strdup(error.what());
  } catch (...) {
    return strdup("an exception without a message");
  }
}

Tensor &tensor(void *pointer) { return *static_cast<Tensor *>(pointer); }

std::vector<Tensor> tensors(void **pointers, size_t count) {
  std::vector<Tensor> result;
  result.reserve(count);
  for (size_t index = 0; index < count; ++index) {
    result.push_back(tensor(pointers[index]));
  }
  return result;
}

}  // namespace

// A graph from some inputs to one output, without the output.
struct Recorded {
  Edge output;
  std::vector<Edge> inputs;
};

namespace {

// The gradients that have reached each input of a node, before the node is computed.
struct Arriving {
  variable_list gradients;
  size_t missing = 0;
};

// Adds a gradient to those that have reached the same input of a node. That of a value which was broadcast is first summed over
// what it was broadcast to.
void add(Tensor &sum, const Edge &edge, Tensor summand) {
  if (!summand.defined()) {
    return;
  }
  const auto &expected = edge.function->input_metadata(edge.input_nr);
  if (!expected.is_same_shape(summand)) {
    summand = expected.reduce_grad(summand);
  }
  sum = sum.defined() ? sum + summand : std::move(summand);
}

// The gradients of the graph's inputs. PyTorch's engine would compute them on a thread of the GPU, and an operation's few nodes
// would wait longer for that thread than they take. Here the nodes run on the caller's thread, each one after those that it
// depends on.
variable_list differentiate(const Recorded &recorded, const Tensor &gradient) {
  std::unordered_map<Node *, Arriving> arriving;
  std::vector<std::shared_ptr<Node>> ready = {recorded.output.function};
  for (size_t place = 0; place < ready.size(); ++place) {
    for (const auto &edge : ready[place]->next_edges()) {
      if (edge.is_valid() && arriving[edge.function.get()].missing++ == 0) {
        ready.push_back(edge.function);
      }
    }
  }
  ready.resize(1);
  auto &first = arriving[recorded.output.function.get()];
  first.gradients.resize(recorded.output.function->num_inputs());
  first.gradients[recorded.output.input_nr] = gradient;
  std::unordered_map<Node *, size_t> inputs;
  for (size_t index = 0; index < recorded.inputs.size(); ++index) {
    inputs[recorded.inputs[index].function.get()] = index;
  }
  variable_list results(recorded.inputs.size());
  while (!ready.empty()) {
    auto node = std::move(ready.back());
    ready.pop_back();
    auto here = std::move(arriving[node.get()].gradients);
    if (auto input = inputs.find(node.get()); input != inputs.end()) {
      results[input->second] = here[0];
      continue;
    }
    auto gradients = (*node)(std::move(here));
    node->release_variables();
    const auto &edges = node->next_edges();
    for (size_t index = 0; index < edges.size(); ++index) {
      if (!edges[index].is_valid()) {
        continue;
      }
      auto &next = arriving[edges[index].function.get()];
      next.gradients.resize(edges[index].function->num_inputs());
      add(next.gradients[edges[index].input_nr], edges[index], std::move(gradients[index]));
      if (--next.missing == 0) {
        ready.push_back(edges[index].function);
      }
    }
  }
  return results;
}

}  // namespace

extern "C" {

void torqued_free(char *message) { free(message); }

char *torqued_record(void *output, void **inputs, size_t count, Recorded **recorded) {
  return attempt([&] {
    auto made = std::make_unique<Recorded>();
    made->output = torch::autograd::impl::gradient_edge(tensor(output));
    for (size_t index = 0; index < count; ++index) {
      made->inputs.push_back(torch::autograd::impl::gradient_edge(tensor(inputs[index])));
    }
    *recorded = made.release();
  });
}

// Writes a new tensor for each input, which the caller deletes, or null where the output does not depend on the input. The
// graph then frees what it saved.
char *torqued_differentiate(Recorded *recorded, void *gradient, void **results) {
  return attempt([&] {
    at::NoGradGuard no_gradients;
    auto gradients = differentiate(*recorded, tensor(gradient));
    for (size_t index = 0; index < gradients.size(); ++index) {
      results[index] = gradients[index].defined() ? new Tensor(gradients[index]) : nullptr;
    }
  });
}

void torqued_forget(Recorded *recorded) { delete recorded; }

// Products and convolutions round their factors to TF32 if `is_tf32`. cuDNN takes only kernels whose results repeat.
char *torqued_configure(bool is_tf32) {
  return attempt([&] {
    auto &context = at::globalContext();
    context.setAllowTF32CuBLAS(is_tf32);
    context.setAllowTF32CuDNN(is_tf32);
    context.setDeterministicCuDNN(true);
    context.setBenchmarkCuDNN(false);
  });
}

const char *torqued_torch_version() { return TORCH_VERSION; }

// The name of the first GPU and the version of CUDA that its driver has. False if there is no driver.
bool torqued_gpu(char *name, int size, int *version) {
  void *driver = dlopen("libcuda.so.1", RTLD_NOW | RTLD_LOCAL);
  if (driver == nullptr) {
    return false;
  }
  auto get_name = reinterpret_cast<int (*)(char *, int, int)>(dlsym(driver, "cuDeviceGetName"));
  auto get_version = reinterpret_cast<int (*)(int *)>(dlsym(driver, "cuDriverGetVersion"));
  return get_name != nullptr && get_version != nullptr && get_name(name, size, 0) == 0 && get_version(version) == 0;
}

// Starts the random numbers of PyTorch anew.
char *torqued_seed(bool is_on_gpu, uint64_t seed) {
  return attempt([&] {
    auto generator = at::globalContext().defaultGenerator(is_on_gpu ? at::kCUDA : at::kCPU);
    std::lock_guard<std::mutex> lock(generator.mutex());
    generator.set_current_seed(seed);
  });
}

// The most bytes that tensors had on the GPU at once since the last call, or 0 without one.
char *torqued_peak_bytes(int64_t *bytes) {
  return attempt([&] {
    *bytes = 0;
    if (at::globalContext().hasCUDA()) {
      // Before the first tensor there is no allocator to ask.
      at::empty({1}, at::device(at::kCUDA));
      *bytes = at::accelerator::getDeviceStats(0).allocated_bytes[0].peak;
      at::accelerator::resetPeakStats(0);
    }
  });
}

// One step of AdamW. The moments change in place. Writes a new tensor for each weight, which the caller deletes.
char *torqued_adam_w(size_t count, void **weights, void **gradients, void **first, void **second, double time,
                     double learning_rate, double beta_1, double beta_2, double weight_decay, double epsilon,
                     double scale, void **updated) {
  return attempt([&] {
    at::NoGradGuard no_gradients;
    if (count == 0) {
      return;
    }
    auto all = at::_foreach_mul(tensors(weights, count), 1.0);
    auto options = all[0].options();
    std::vector<Tensor> times(count, at::full({}, time, options));
    std::optional<Tensor> divisor;
    if (scale != 1.0) {
      divisor = at::full({}, 1.0 / scale, options);
    }
    at::_fused_adamw_(all, tensors(gradients, count), tensors(first, count), tensors(second, count), {}, times,
                      learning_rate, beta_1, beta_2, weight_decay, epsilon, false, false, divisor, std::nullopt);
    for (size_t index = 0; index < count; ++index) {
      updated[index] = new Tensor(all[index]);
    }
  });
}

// The Euclidean norm over all numbers of all tensors.
char *torqued_norm(size_t count, void **values, double *norm) {
  return attempt([&] {
    at::NoGradGuard no_gradients;
    auto norms = at::_foreach_norm(tensors(values, count));
    *norm = at::stack(norms).to(at::kDouble).norm().item<double>();
  });
}
}
