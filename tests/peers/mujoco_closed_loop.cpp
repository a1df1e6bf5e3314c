// Lets MuJoCo move an arm under a controller, as mujoco_closed_loop.py describes it. Prints JSON.
//
//   mujoco_closed_loop rate ARM KNOWN LAW INTEGRATOR [alone] < FLIGHT   trajectories per second
//   mujoco_closed_loop torques KNOWN LAW < STATES                       a line of torques per state
//
// ARM and KNOWN are compiled models: the arm that moves, and the nominal one that the controller
// knows. With `alone`, the arm moves without its controller. The controller calls only those of
// MuJoCo's functions that its law needs, and allocates nothing. Its reference is given as
// polynomials, so that the reference itself costs MuJoCo nothing.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <string>
#include <vector>

#include <mujoco/mujoco.h>

constexpr int JOINTS = 7, TASK = 6, LAST = JOINTS, MAX_DELAY = 3;
// So many that a measurement takes as long as one of torqued.
constexpr int FLIGHTS = 12;
using Joints = double[JOINTS];
using Motion = double[TASK];

void read(double *numbers, int count) {
  for (int i = 0; i < count; i++) std::cin >> numbers[i];
  if (!std::cin) {
    std::fprintf(stderr, "numbers are missing\n");
    std::exit(1);
  }
}

double read() {
  double number;
  read(&number, 1);
  return number;
}

mjModel *load(const char *file) {
  mjModel *model = mj_loadModel(file, nullptr);
  if (model && model->nv == JOINTS && model->nq == JOINTS) return model;
  std::fprintf(stderr, "%s is no model of an arm with seven joints\n", file);
  std::exit(1);
}

enum class Law { JointPd, ComputedTorque, OperationalSpace, CartesianImpedance };

Law law_of(const std::string &name) {
  const char *names[] = {"joint-pd", "computed-torque", "operational-space", "cartesian-impedance"};
  for (int law = 0; law < 4; law++)
    if (name == names[law]) return Law(law);
  std::fprintf(stderr, "%s is no law\n", name.c_str());
  std::exit(1);
}

struct Gains {
  // Each is one number per joint, or per direction of the task.
  double kp[JOINTS], kd[JOINTS], ki[JOINTS];
  double kn, dn;
};

void cross(const double a[3], const double b[3], double product[3]) {
  product[0] = a[1] * b[2] - a[2] * b[1];
  product[1] = a[2] * b[0] - a[0] * b[2];
  product[2] = a[0] * b[1] - a[1] * b[0];
}

// The hand of an arm: a point on z of the last link. Motions have the velocity of the point first.
struct Hand {
  double position[3], axes[9];
  // Column by column.
  double jacobian[JOINTS][TASK];

  // MuJoCo's `cdof` are about the centre of mass of the arm, the turning first.
  void look(const mjModel *model, const mjData *data, double flange) {
    std::copy_n(data->xmat + 9 * LAST, 9, axes);
    double arm[3];
    for (int i = 0; i < 3; i++) {
      position[i] = data->xpos[3 * LAST + i] + flange * axes[3 * i + 2];
      arm[i] = position[i] - data->subtree_com[3 * model->body_rootid[LAST] + i];
    }
    for (int joint = 0; joint < JOINTS; joint++) moved(data->cdof + 6 * joint, arm, jacobian[joint]);
  }

  static void moved(const double *about_center, const double arm[3], double *motion) {
    cross(about_center, arm, motion);
    for (int i = 0; i < 3; i++) {
      motion[i] += about_center[3 + i];
      motion[3 + i] = about_center[i];
    }
  }

  void velocity(const double *qd, Motion motion) const {
    std::fill_n(motion, TASK, 0.0);
    for (int joint = 0; joint < JOINTS; joint++)
      for (int row = 0; row < TASK; row++) motion[row] += jacobian[joint][row] * qd[joint];
  }

  // J q̈ + J̇ q̇, where the velocities of `data` are q̇ and its motion is `velocity`.
  void acceleration(const mjModel *model, const mjData *data, const double *qd, const double *qdd,
                    const Motion velocity, Motion motion) const {
    double changing[6] = {};
    for (int joint = 0; joint < JOINTS; joint++)
      for (int i = 0; i < 6; i++) changing[i] += data->cdof_dot[6 * joint + i] * qd[joint];
    double arm[3], centripetal[3];
    for (int i = 0; i < 3; i++)
      arm[i] = position[i] - data->subtree_com[3 * model->body_rootid[LAST] + i];
    moved(changing, arm, motion);
    cross(velocity + 3, velocity, centripetal);
    for (int i = 0; i < 3; i++) motion[i] += centripetal[i];
    for (int joint = 0; joint < JOINTS; joint++)
      for (int row = 0; row < TASK; row++) motion[row] += jacobian[joint][row] * qdd[joint];
  }
};

// Solves for `b` with a positive definite matrix, of which the lower half is given.
void solve(double matrix[TASK][TASK], Motion b) {
  double inverse[TASK];
  for (int column = 0; column < TASK; column++) {
    for (int inner = 0; inner < column; inner++)
      for (int row = column; row < TASK; row++)
        matrix[row][column] -= matrix[row][inner] * matrix[column][inner];
    inverse[column] = 1 / std::sqrt(matrix[column][column]);
    for (int row = column; row < TASK; row++) matrix[row][column] *= inverse[column];
  }
  for (int row = 0; row < TASK; row++) {
    for (int inner = 0; inner < row; inner++) b[row] -= matrix[row][inner] * b[inner];
    b[row] *= inverse[row];
  }
  for (int row = TASK - 1; row >= 0; row--) {
    for (int later = row + 1; later < TASK; later++) b[row] -= matrix[later][row] * b[later];
    b[row] *= inverse[row];
  }
}

struct Controller {
  Law law;
  const mjModel *model;
  double flange;
  Gains gains;
  // At the measured state, and at the reference.
  mjData *here = mj_makeData(model), *there = mj_makeData(model);
  Hand hand, goal;
  Joints sum = {};

  Controller(Law law, const mjModel *model) : law(law), model(model) {
    // Velocities are 0 where a law needs only gravity.
    mj_forward(model, here);
  }

  bool is_of_hand() const { return law == Law::OperationalSpace || law == Law::CartesianImpedance; }

  void read_gains() {
    const int count = is_of_hand() ? TASK : JOINTS;
    flange = read();
    read(gains.kp, count), read(gains.kd, count), read(gains.ki, count);
    gains.kn = read(), gains.dn = read();
  }

  void torques(const double *q, const double *v, const double course[3][JOINTS], double period,
               double *torque) {
    const double *r = course[0], *rd = course[1], *rdd = course[2];
    std::copy_n(q, JOINTS, here->qpos);
    mj_kinematics(model, here);
    mj_comPos(model, here);
    if (law == Law::ComputedTorque || law == Law::OperationalSpace) {
      std::copy_n(v, JOINTS, here->qvel);
      mj_comVel(model, here);
    }
    if (is_of_hand()) {
      hand_torques(q, v, r, rd, rdd, torque);
      return;
    }
    Joints wish;
    for (int joint = 0; joint < JOINTS; joint++) {
      const double error = r[joint] - q[joint];
      sum[joint] += error * period;
      wish[joint] = gains.kp[joint] * error + gains.kd[joint] * (rd[joint] - v[joint]) +
                    gains.ki[joint] * sum[joint];
    }
    if (law == Law::JointPd) {
      mj_rne(model, here, 0, torque);
      for (int joint = 0; joint < JOINTS; joint++) torque[joint] += wish[joint];
    } else {
      for (int joint = 0; joint < JOINTS; joint++) here->qacc[joint] = rdd[joint] + wish[joint];
      inverse_dynamics(torque);
    }
  }

  // Torques for the accelerations in `here`.
  void inverse_dynamics(double *torque) {
    mj_rne(model, here, 1, torque);
    for (int joint = 0; joint < JOINTS; joint++)
      torque[joint] += model->dof_armature[joint] * here->qacc[joint];
  }

  void hand_torques(const double *q, const double *v, const double *r, const double *rd,
                    const double *rdd, double *torque) {
    std::copy_n(r, JOINTS, there->qpos);
    mj_kinematics(model, there);
    mj_comPos(model, there);
    goal.look(model, there, flange);
    hand.look(model, here, flange);
    Motion speed, goal_speed, force;
    hand.velocity(v, speed);
    goal.velocity(rd, goal_speed);
    Motion error = {};
    for (int axis = 0; axis < 3; axis++) {
      error[axis] = goal.position[axis] - hand.position[axis];
      const double *a = hand.axes + axis, *b = goal.axes + axis;
      error[3] += 0.5 * (a[3] * b[6] - a[6] * b[3]);
      error[4] += 0.5 * (a[6] * b[0] - a[0] * b[6]);
      error[5] += 0.5 * (a[0] * b[3] - a[3] * b[0]);
    }
    for (int row = 0; row < TASK; row++)
      force[row] = gains.kp[row] * error[row] + gains.kd[row] * (goal_speed[row] - speed[row]);
    Joints kept;
    for (int joint = 0; joint < JOINTS; joint++)
      kept[joint] = gains.kn * (r[joint] - q[joint]) + gains.dn * (rd[joint] - v[joint]);

    double matrix[TASK][TASK];
    if (law == Law::OperationalSpace) {
      for (int joint = 0; joint < JOINTS; joint++) kept[joint] += rdd[joint];
      std::copy_n(rd, JOINTS, there->qvel);
      mj_comVel(model, there);
      Motion wanted, given;
      goal.acceleration(model, there, rd, rdd, goal_speed, wanted);
      hand.acceleration(model, here, v, kept, speed, given);
      for (int row = 0; row < TASK; row++) force[row] += wanted[row] - given[row];
      std::copy_n(kept, JOINTS, here->qacc);
      inverse_dynamics(torque);
      mj_makeM(model, here);
      mj_factorM(model, here);
      double rows[TASK][JOINTS], reduced[TASK][JOINTS], roots[JOINTS];
      for (int joint = 0; joint < JOINTS; joint++) {
        roots[joint] = std::sqrt(here->qLDiagInv[joint]);
        for (int row = 0; row < TASK; row++) rows[row][joint] = hand.jacobian[joint][row];
      }
      mj_solveM2(model, here, reduced[0], rows[0], roots, TASK);
      for (int row = 0; row < TASK; row++)
        for (int column = 0; column <= row; column++) {
          matrix[row][column] = 0;
          for (int joint = 0; joint < JOINTS; joint++)
            matrix[row][column] += reduced[row][joint] * reduced[column][joint];
        }
      solve(matrix, force);
    } else {
      mj_rne(model, here, 0, torque);
      for (int joint = 0; joint < JOINTS; joint++) torque[joint] += kept[joint];
      Motion pushed;
      hand.velocity(kept, pushed);
      for (int row = 0; row < TASK; row++)
        for (int column = 0; column <= row; column++) {
          matrix[row][column] = 0;
          for (int joint = 0; joint < JOINTS; joint++)
            matrix[row][column] += hand.jacobian[joint][row] * hand.jacobian[joint][column];
        }
      solve(matrix, pushed);
      for (int row = 0; row < TASK; row++) force[row] -= pushed[row];
    }
    for (int joint = 0; joint < JOINTS; joint++)
      for (int row = 0; row < TASK; row++) torque[joint] += hand.jacobian[joint][row] * force[row];
  }
};

// A reference within a sampling period, and its derivatives.
void reference_at(const double plan[JOINTS][6], double share, double rate, double course[3][JOINTS]) {
  for (int joint = 0; joint < JOINTS; joint++) {
    const double *c = plan[joint];
    double r = c[5], rd = 5 * c[5], rdd = 20 * c[5];
    for (int power = 4; power >= 0; power--) r = r * share + c[power];
    for (int power = 4; power >= 1; power--) rd = rd * share + power * c[power];
    for (int power = 4; power >= 2; power--) rdd = rdd * share + power * (power - 1) * c[power];
    course[0][joint] = r, course[1][joint] = rd * rate, course[2][joint] = rdd * rate * rate;
  }
}

// The rest of the controller: the low-pass of velocities, limits and delay.
void fly(mjModel *arm, Controller &controller, bool alone) {
  const double rate = read(), control_rate = read(), smoothing = read(), change = read();
  Joints most, start, start_speed, q, velocity, weight;
  read(most, JOINTS), read(start, JOINTS), read(start_speed, JOINTS);
  const int delay = int(read()), samples = int(read());
  std::vector<double> plans(samples * JOINTS * 6);
  read(plans.data(), int(plans.size()));
  const int periods = int(std::lround(control_rate / rate));
  const double period = 1 / control_rate;
  arm->opt.timestep = period;
  mjData *data = mj_makeData(arm);
  std::copy_n(start, JOINTS, controller.here->qpos);
  mj_forward(controller.model, controller.here);
  std::copy_n(controller.here->qfrc_bias, JOINTS, weight);
  double commands[MAX_DELAY + 1][JOINTS], largest_error = 0;
  int latest = 0;

  const auto begin = std::chrono::steady_clock::now();
  for (int flown = 0; flown < FLIGHTS * samples; flown++) {
    const int sample = flown % samples;
    if (sample == 0) {
      mj_resetData(arm, data);
      std::copy_n(start, JOINTS, data->qpos);
      std::copy_n(start_speed, JOINTS, data->qvel);
      std::copy_n(start, JOINTS, q);
      std::copy_n(start_speed, JOINTS, velocity);
      std::fill_n(controller.sum, JOINTS, 0.0);
      for (auto &command : commands) std::copy_n(weight, JOINTS, command);
    }
    const auto *plan = reinterpret_cast<const double(*)[6]>(plans.data() + sample * JOINTS * 6);
    for (int number = 0; number < periods; number++) {
      if (!alone) {
        for (int joint = 0; joint < JOINTS; joint++) {
          const double measured = data->qpos[joint];
          velocity[joint] += smoothing * ((measured - q[joint]) * control_rate - velocity[joint]);
          q[joint] = measured;
        }
        double course[3][JOINTS], command[JOINTS];
        reference_at(plan, double(number) / periods, rate, course);
        controller.torques(q, velocity, course, period, command);
        const double *before = commands[latest];
        latest = (latest + 1) & MAX_DELAY;
        for (int joint = 0; joint < JOINTS; joint++) {
          const double limited = std::clamp(command[joint], -most[joint], most[joint]);
          commands[latest][joint] =
              before[joint] + std::clamp(limited - before[joint], -change, change);
          largest_error = std::max(largest_error, std::abs(course[0][joint] - q[joint]));
        }
        const double *acts = commands[(latest - delay) & MAX_DELAY];
        std::copy_n(acts, JOINTS, data->qfrc_applied);
      }
      mj_step(arm, data);
    }
  }
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  std::printf("{\"trajectories_per_s\": %.6f, \"largest_error_rad\": %.9f}\n", FLIGHTS / took.count(),
              largest_error);
}

int main(int count, char **arguments) {
  const std::string mode = count > 1 ? arguments[1] : "";
  if (mode == "rate" && (count == 6 || count == 7)) {
    mjModel *arm = load(arguments[2]);
    const std::string integrator = arguments[5];
    arm->opt.integrator = integrator == "Euler" ? mjINT_EULER : mjINT_RK4;
    Controller controller(law_of(arguments[4]), load(arguments[3]));
    controller.read_gains();
    fly(arm, controller, count == 7);
    return 0;
  }
  if (mode == "torques" && count == 4) {
    Controller controller(law_of(arguments[3]), load(arguments[2]));
    controller.read_gains();
    for (int left = int(read()); left > 0; left--) {
      Joints q, v, torque;
      double course[3][JOINTS];
      read(q, JOINTS), read(v, JOINTS), read(course[0], 3 * JOINTS);
      controller.torques(q, v, course, 0, torque);
      for (double value : torque) std::printf("%.17g ", value);
      std::printf("\n");
    }
    return 0;
  }
  std::fprintf(stderr, "see the head of this program's source\n");
  return 1;
}
