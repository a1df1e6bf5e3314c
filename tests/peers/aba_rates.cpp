// Prints how many articulated-body evaluations per second Pinocchio makes, as one line of JSON.
//
// A file that urdf_joints.py printed replaces the Panda. All evaluations share one arm and use 1024
// random states. This suits Pinocchio best, because a model per robot is slower. The faster of its
// two conventions counts. Everything is compiled from headers for this processor. Nothing of the
// packaged library, which is built for all processors, is called.

#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <pinocchio/config.hpp>
#include <pinocchio/multibody.hpp>
#include <pinocchio/algorithm/aba.hpp>

namespace pin = pinocchio;

using Joints = Eigen::VectorXd;
using Clock = std::chrono::steady_clock;

// a, alpha in quarter turns, d; mass; centre of mass; inertia xx xy yy xz yz zz about it
// (Gaz et al. 2019, tables I, VIII and IX).
const double LINKS[7][13] = {
    {0, 0, 0.333, 4.970684, 0.003875, 0.002081, -0.175,
     0.70337, -0.000139, 0.70661, 0.006772, 0.019169, 0.009117},
    {0, -1, 0, 0.646926, -0.003141, -0.02872, 0.003495,
     0.007962, -0.003925, 0.02811, 0.010254, 0.000704, 0.025995},
    {0, 1, 0.316, 3.228604, 0.027518, 0.039252, -0.066502,
     0.037242, -0.004761, 0.036155, -0.011396, -0.012805, 0.01083},
    {0.0825, 1, 0, 3.587895, -0.05317, 0.104419, 0.027454,
     0.025853, 0.007796, 0.019552, -0.001332, 0.008641, 0.028323},
    {-0.0825, -1, 0.384, 1.225946, -0.011953, 0.041065, -0.038437,
     0.035549, -0.002117, 0.029474, -0.004037, 0.000229, 0.008627},
    {0, 1, 0, 1.666555, 0.060149, -0.014117, -0.010517,
     0.001964, 0.000109, 0.004354, -0.001158, 0.000341, 0.005433},
    {0.088, 1, 0, 0.735522, 0.010517, -0.004252, 0.061597,
     0.012516, -0.000428, 0.010027, -0.001196, -0.000741, 0.004815},
};

pin::Model panda() {
  pin::Model model;
  pin::JointIndex parent = 0;
  for (const auto &link : LINKS) {
    const double quarter = std::acos(-1.0) / 2;
    const Eigen::Matrix3d twist =
        Eigen::AngleAxisd(quarter * link[1], Eigen::Vector3d::UnitX()).toRotationMatrix();
    const pin::SE3 placement(twist, twist * Eigen::Vector3d(0, 0, link[2]) +
                                        Eigen::Vector3d(link[0], 0, 0));
    parent = model.addJoint(parent, pin::JointModelRZ(), placement,
                            "joint" + std::to_string(parent + 1));
    const pin::Symmetric3 inertia(link[7], link[8], link[9], link[10], link[11], link[12]);
    model.appendBodyToJoint(
        parent, pin::Inertia(link[3], Eigen::Vector3d(link[4], link[5], link[6]), inertia),
        pin::SE3::Identity());
  }
  model.armature.setConstant(0.01);
  return model;
}

pin::Model arm_of(const char *file) {
  pin::Model model;
  pin::JointIndex parent = 0;
  std::ifstream lines(file);
  int axis;
  while (lines >> axis) {
    Eigen::Matrix3d turn;
    Eigen::Vector3d origin, center;
    double mass, inertia[6];
    for (int entry = 0; entry < 9; entry++) lines >> turn(entry / 3, entry % 3);
    for (int entry = 0; entry < 3; entry++) lines >> origin[entry];
    lines >> mass;
    for (int entry = 0; entry < 3; entry++) lines >> center[entry];
    for (double &entry : inertia) lines >> entry;
    const pin::SE3 placement(turn, origin);
    const std::string name = "joint" + std::to_string(parent + 1);
    if (axis == 0) parent = model.addJoint(parent, pin::JointModelRX(), placement, name);
    if (axis == 1) parent = model.addJoint(parent, pin::JointModelRY(), placement, name);
    if (axis == 2) parent = model.addJoint(parent, pin::JointModelRZ(), placement, name);
    const pin::Symmetric3 about_center(inertia[0], inertia[1], inertia[2], inertia[3], inertia[4],
                                       inertia[5]);
    model.appendBodyToJoint(parent, pin::Inertia(mass, center, about_center),
                            pin::SE3::Identity());
  }
  model.armature.setConstant(0.01);
  return model;
}

struct States {
  std::vector<Joints> q, qd, torque;
};

States random_states(int count, int joint_count) {
  std::mt19937_64 generator(20240613);
  const auto joints = [&](double limit) {
    std::uniform_real_distribution<double> uniform(-limit, limit);
    Joints values(joint_count);
    for (int joint = 0; joint < joint_count; joint++) values[joint] = uniform(generator);
    return values;
  };
  States states;
  for (int state = 0; state < count; state++) {
    states.q.push_back(joints(3));
    states.qd.push_back(joints(2.5));
    states.torque.push_back(joints(20));
  }
  return states;
}

// Keeps the compiler from removing unused results.
volatile double sink;

void evaluate(const pin::Model &model, const States &states, pin::Convention convention,
              int rounds) {
  pin::Data data(model);
  double sum = 0;
  for (int round = 0; round < rounds; round++)
    for (size_t state = 0; state < states.q.size(); state++)
      sum += pin::aba(model, data, states.q[state], states.qd[state], states.torque[state],
                      convention)[model.nv - 1];
  sink = sum;
}

// Evaluations per second of all threads together.
double rate(const pin::Model &model, const States &states, pin::Convention convention,
            int threads) {
  const int rounds = 250;
  const auto start = Clock::now();
  std::vector<std::thread> others;
  for (int thread = 1; thread < threads; thread++)
    others.emplace_back(evaluate, std::cref(model), std::cref(states), convention, rounds);
  evaluate(model, states, convention, rounds);
  for (auto &other : others) other.join();
  const double seconds = std::chrono::duration<double>(Clock::now() - start).count();
  return double(threads) * rounds * double(states.q.size()) / seconds;
}

int main(int count, char **arguments) {
  const pin::Model model = count > 1 ? arm_of(arguments[1]) : panda();
  const States states = random_states(1024, model.nv);
  for (const auto convention : {pin::Convention::LOCAL, pin::Convention::WORLD})
    evaluate(model, states, convention, 20);
  double best[2];
  for (int threads = 1; threads <= 2; threads++)
    best[threads - 1] = std::max(rate(model, states, pin::Convention::LOCAL, threads),
                                 rate(model, states, pin::Convention::WORLD, threads));
  std::printf("{\"version\": \"%s\", \"evaluations_per_s\": [%.1f, %.1f]}\n", PINOCCHIO_VERSION,
              best[0], best[1]);
}
