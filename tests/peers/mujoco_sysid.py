"""Identifies an arm with mujoco.sysid from the logs that `torqued identify` takes.

    python tests/peers/mujoco_sysid.py arm.urdf day1.csv day2.csv --validate other.csv \
        --time 1 --q 2-7 --u 14-19 --gains 14.87,13.26,11.13,10.62,11.03,11.47

It has the free numbers of `torqued identify`: for each link ten inertial ones, for each joint friction (Coulomb and
viscous), rotor inertia, torque offset and gain. Windows, initial states and errors are the same: 1.33 s from the
smoothed state. Its residuals are positions of simulated windows; it has bounds instead of a prior. It needs
mujoco[sysid] and scipy.
"""

import argparse
import contextlib
import json
import re
import resource
import sys
import time

import mujoco
import mujoco.rollout
import numpy as np
import scipy.signal
from mujoco import sysid
from mujoco.sysid import model_modifier

HORIZONS_S = (0.1, 0.5, 1.33)
UNCERTAIN_S = 0.25


def places(text):
    """`2-7` or `1,3` as indices from 0."""
    found = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        found += range(int(first) - 1, int(last or first))
    return found


class Log:
    """A log at even times, its motion after a low-pass, and its torques as they were recorded."""

    def __init__(self, path, arguments):
        rows = []
        for line in open(path):
            try:
                rows.append([float(value) for value in line.split(",")])
            except ValueError:
                continue
        width = max(len(row) for row in rows)
        table = np.array([row for row in rows if len(row) == width])
        t = table[:, places(arguments.time)[0]]
        table, t = table[np.r_[True, np.diff(t) > 0]], t[np.r_[True, np.diff(t) > 0]]
        self.rate_hz = 1 / np.median(np.diff(t))
        even = np.arange(t[0], t[-1], 1 / self.rate_hz)

        def column(k):
            return np.interp(even, t, table[:, k])

        q = np.column_stack([column(k) for k in places(arguments.q)])
        gains = [float(gain) for gain in arguments.gains.split(",")]
        self.u = np.column_stack([column(k) for k in places(arguments.u)]) * gains
        # Half of the amplitude is left at the edge after both passes.
        edge = arguments.low_pass_hz / (2**0.5 - 1) ** 0.125
        b, a = scipy.signal.butter(4, edge, fs=self.rate_hz)
        self.q = scipy.signal.filtfilt(b, a, q, axis=0)
        self.qd = np.gradient(self.q, 1 / self.rate_hz, axis=0)

    def starts(self, every_s):
        """The first samples of windows of the longest horizon."""
        samples = lambda seconds: round(seconds * self.rate_hz)
        last = len(self.q) - samples(HORIZONS_S[-1]) - samples(UNCERTAIN_S) - 1
        return range(samples(UNCERTAIN_S), last, samples(every_s))


def load(path):
    """The arm without what can be seen, with a motor and a sensor of position at each joint."""
    text = open(path).read()
    text = re.sub(r"<(visual|collision)\b.*?</\1>", "", text, flags=re.S)
    text = re.sub(r"<(transmission|gazebo)\b.*?</\1>", "", text, flags=re.S)
    spec = mujoco.MjSpec.from_string(text)
    spec.option.timestep = 0.002
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    spec.compiler.balanceinertia = True
    names = [joint.name for joint in spec.joints]
    for name in names:
        actuator = spec.add_actuator(name=f"{name}_motor", target=name)
        actuator.trntype = mujoco.mjtTrn.mjTRN_JOINT
        actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        spec.add_sensor(
            name=f"{name}_pos",
            type=mujoco.mjtSensor.mjSENS_JOINTPOS,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=name,
        )
    return spec, names


def write_body(spec, body, theta):
    """What sysid's own modifier does, with principal axes: MuJoCo 4.0.0 refuses the body that it writes."""
    pi = model_modifier.pi_from_theta(theta)
    mass, center, inertia = pi[0], pi[1:4] / pi[0], pi[4:].reshape(3, 3)
    skew = model_modifier.skew(center)
    moments, axes = np.linalg.eigh(inertia + mass * skew @ skew)
    axes[:, 0] *= np.linalg.det(axes)
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, axes.flatten())
    body = spec.body(body)
    body.mass, body.ipos, body.inertia, body.iquat = mass, center, moments, quat


def parameters(spec, names, effort):
    params = sysid.ParameterDict()
    model = spec.compile()
    for joint in range(model.njnt):
        body = model.body(model.jnt_bodyid[joint]).name

        def write(spec, param, body=body):
            write_body(spec, body, param.value)

        pseudo = sysid.InertiaType.Pseudo
        params.add(sysid.body_inertia_param(spec, model, body, inertia_type=pseudo, modifier=write))

    def of_joint(name, field, nominal, most):
        def write(spec, param):
            joint = spec.joint(name)
            if np.ndim(getattr(joint, field)):
                getattr(joint, field)[0] = param.value[0]  # The linear part of a polynomial.
            else:
                setattr(joint, field, param.value[0])

        params.add(sysid.Parameter(f"{name}_{field}", nominal, 0.0, most, modifier=write))

    def of_motor(name, field, at, nominal, least, most):
        def write(spec, param):
            getattr(spec.actuator(f"{name}_motor"), field)[at] = param.value[0]

        params.add(sysid.Parameter(f"{name}_{field}", nominal, least, most, modifier=write))

    for name, rated in zip(names, effort):
        of_joint(name, "damping", 0.005 * rated, rated)
        of_joint(name, "frictionloss", 0.01 * rated, rated)
        of_joint(name, "armature", 0.001 * rated, 0.1 * rated)
        of_motor(name, "gainprm", 0, 1.0, 0.5, 1.5)
        of_motor(name, "biasprm", 0, 0.0, -0.2 * rated, 0.2 * rated)
    return params


def windows(logs, model, names, every_s):
    """Initial states, torques and measured positions of all windows."""
    states, controls, sensors = [], [], []
    for log in logs:
        samples = round(HORIZONS_S[-1] * log.rate_hz) + 1
        times = np.arange(samples) / log.rate_hz
        for start in log.starts(every_s):
            part = slice(start, start + samples)
            states.append(sysid.create_initial_state(model, log.q[start], log.qd[start], np.zeros(0)))
            controls.append(sysid.TimeSeries(times, log.u[part]))
            sensors.append(sysid.TimeSeries.from_names(times, log.q[part], model))
    return states, controls, sensors


def errors(model, logs, every_s):
    """RMSE over each horizon, mean over joints and windows, degrees."""
    sums, count = np.zeros((3, len(HORIZONS_S))), 0
    data = mujoco.MjData(model)
    steps = model.opt.timestep
    for log in logs:
        samples = round(HORIZONS_S[-1] * log.rate_hz) + 1
        for start in log.starts(every_s):
            state = sysid.create_initial_state(model, log.q[start], log.qd[start], np.zeros(0))
            fine = np.arange(0, (samples - 1) / log.rate_hz, steps)
            held = np.minimum((fine * log.rate_hz + 1e-9).astype(int), samples - 1)
            _, sensor = mujoco.rollout.rollout(model, data, state, log.u[start + held])
            at = np.round(np.arange(1, samples) / log.rate_hz / steps).astype(int) - 1
            predicted = sensor[0, np.minimum(at, len(fine) - 1)]
            truth = log.q[start + 1 : start + samples]
            ahead = np.arange(1, samples)[:, None] / log.rate_hz
            for row, guess in enumerate(
                (log.q[start] + 0 * truth, log.q[start] + log.qd[start] * ahead, predicted)
            ):
                for k, horizon in enumerate(HORIZONS_S):
                    n = round(horizon * log.rate_hz)
                    sums[row, k] += np.sqrt(np.mean((guess[:n] - truth[:n]) ** 2, axis=0)).mean()
            count += 1
    rows = np.degrees(sums / count)
    return dict(zip(("hold", "constant velocity", "mujoco.sysid"), rows.tolist()))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("arm")
    parser.add_argument("logs", nargs="+")
    parser.add_argument("--validate", action="append", default=[])
    parser.add_argument("--time", required=True)
    parser.add_argument("--q", required=True)
    parser.add_argument("--u", required=True)
    parser.add_argument("--gains", required=True)
    parser.add_argument("--low-pass-hz", type=float, default=8)
    parser.add_argument("--every-s", type=float, default=0.67)
    parser.add_argument("--iterations", type=int, default=30)
    arguments = parser.parse_args()

    spec, names = load(arguments.arm)
    model = spec.compile()
    effort = [float(limit) for limit in re.findall(r'effort="([\d.]+)"', open(arguments.arm).read())]
    logs = [Log(path, arguments) for path in arguments.logs]
    validation = [Log(path, arguments) for path in arguments.validate]
    params = parameters(spec, names, effort[: len(names)])
    states, controls, sensors = windows(logs, model, names, arguments.every_s)
    sequences = sysid.ModelSequences(
        "arm", spec, [str(k) for k in range(len(states))], states, controls, sensors
    )
    began, processor = time.perf_counter(), time.process_time()
    residual = sysid.build_residual_fn(models_sequences=[sequences])
    # It prints its iterations, whatever `verbose` says.
    with contextlib.redirect_stdout(sys.stderr):
        found, _ = sysid.optimize(params, residual, max_iters=arguments.iterations, verbose=False)
    seconds, processor = time.perf_counter() - began, time.process_time() - processor
    fitted = sysid.apply_param_modifiers(found, spec)
    print(
        json.dumps(
            {
                "mujoco": mujoco.__version__,
                "windows": len(states),
                "free": int(params.size),
                "seconds": seconds,
                "processor_seconds": processor,
                "peak_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
                "fit": errors(fitted, logs, 1.0),
                "validation": errors(fitted, validation, 1.0) if validation else None,
            },
            indent=1,
        )
    )


main()
