"""Writes the numbers that the dynamics are tested against, computed with Pinocchio.

    python3 -m venv /tmp/pinocchio && /tmp/pinocchio/bin/pip install pin==4.1.0
    /tmp/pinocchio/bin/python dynamics/tests/peers/pinocchio_reference.py

Nothing here is shared with the Rust code: the arm is entered anew from its sources, bodies are
welded by Pinocchio, and trajectories are integrated with Pinocchio's articulated-body algorithm.
"""

import json
import math
from pathlib import Path

import numpy as np
import pinocchio as pin

OUTPUT = Path(__file__).parents[1] / "data" / "pinocchio.json"

# Modified Denavit-Hartenberg rows a, alpha, d (Gaz et al. 2019).
DENAVIT_HARTENBERG = [
    (0, 0, 0.333), (0, -90, 0), (0, 90, 0.316), (0.0825, 90, 0), (-0.0825, -90, 0.384), (0, 90, 0), (0.088, 90, 0),
]
# Mass, centre of mass, inertia xx xy xz yy yz zz about it: links 1 to 7 (Gaz et al. 2019), then the
# hand and a finger (simulator of the paper, GunesCaginAydin/dynamical-metalearning).
LINKS = [
    (4.970684, (0.003875, 0.002081, -0.175), (0.70337, -0.000139, 0.006772, 0.70661, 0.019169, 0.009117)),
    (0.646926, (-0.003141, -0.02872, 0.003495), (0.007962, -0.003925, 0.010254, 0.02811, 0.000704, 0.025995)),
    (3.228604, (0.027518, 0.039252, -0.066502), (0.037242, -0.004761, -0.011396, 0.036155, -0.012805, 0.01083)),
    (3.587895, (-0.05317, 0.104419, 0.027454), (0.025853, 0.007796, -0.001332, 0.019552, 0.008641, 0.028323)),
    (1.225946, (-0.011953, 0.041065, -0.038437), (0.035549, -0.002117, -0.004037, 0.029474, 0.000229, 0.008627)),
    (1.666555, (0.060149, -0.014117, -0.010517), (0.001964, 0.000109, -0.001158, 0.004354, 0.000341, 0.005433)),
    (0.735522, (0.010517, -0.004252, 0.061597), (0.012516, -0.000428, -0.001196, 0.010027, -0.000741, 0.004815)),
]
HAND = (0.717156708240509, (4.3e-5, -0.00093, 0.024119), (0.002462, -2e-6, -1e-6, 0.000492, -1.5e-5, 0.000691))
FINGER = (0.021579869091510773, (1.7e-5, 0.011958, 0.023777), (6e-6, -1e-7, 1e-7, 5e-6, 1e-6, 2e-6))
MIRRORED_FINGER = (FINGER[0], (-1.7e-5, -0.011958, 0.023777), (6e-6, -1e-7, -1e-7, 5e-6, -1e-6, 2e-6))

rng = np.random.default_rng(20240613)


def matrix(entries):
    xx, xy, xz, yy, yz, zz = entries
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def entries(inertia):
    return [inertia[0, 0], inertia[0, 1], inertia[0, 2], inertia[1, 1], inertia[1, 2], inertia[2, 2]]


def inertia(body):
    mass, com, tensor = body
    return pin.Inertia(mass, np.array(com), matrix(tensor))


def physical(body):
    """The body with negative principal second moments raised to almost zero."""
    mass, com, tensor = body
    tensor = matrix(tensor)
    moments, axes = np.linalg.eigh(0.5 * np.trace(tensor) * np.eye(3) - tensor)
    moments = axes @ np.diag(np.maximum(moments, 1e-9 * moments.max())) @ axes.T
    return mass, com, entries(np.trace(moments) * np.eye(3) - moments)


def arm(links, armature, gravity):
    """A Panda-shaped arm; `links` are (mass, com, inertia) tuples."""
    model = pin.Model()
    joint = 0
    for index, (a, alpha, d) in enumerate(DENAVIT_HARTENBERG):
        turn = pin.SE3(pin.rpy.rpyToMatrix(math.radians(alpha), 0, 0), np.zeros(3))
        placement = turn * pin.SE3(np.eye(3), np.array([a, 0, d]))
        joint = model.addJoint(joint, pin.JointModelRZ(), placement, f"joint{index + 1}")
        model.appendBodyToJoint(joint, inertia(links[index]), pin.SE3.Identity())
    model.armature = np.array(armature)
    model.gravity.linear = np.array([0, 0, -gravity])
    return model


def panda():
    model = arm(LINKS, [0.01] * 7, 9.81)
    hand = pin.SE3(pin.rpy.rpyToMatrix(0, 0, -math.pi / 4), np.array([0, 0, 0.107]))
    model.appendBodyToJoint(7, inertia(physical(HAND)), hand)
    model.appendBodyToJoint(7, inertia(FINGER), hand * pin.SE3(np.eye(3), np.array([0, 0.04, 0.0584])))
    model.appendBodyToJoint(7, inertia(MIRRORED_FINGER), hand * pin.SE3(np.eye(3), np.array([0, -0.04, 0.0584])))
    return model


def rounded(values, digits=7):
    """Inputs need few digits; they are rounded before use, so that both sides use the same."""
    return [float(f"{value:.{digits}g}") for value in np.ravel(values)]


def random_links(spread):
    """Masses and centres around the Panda's, second moments of its size along random axes."""
    links = []
    for mass, com, tensor in LINKS:
        axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        moments = 0.5 * np.trace(matrix(tensor)) * axes @ np.diag(rng.uniform(0.05, 1, 3)) @ axes.T
        mass = mass * rng.uniform(1 - spread, 1 + spread)
        com = np.array(com) * rng.uniform(1 - spread, 1 + spread, 3)
        tensor = entries(np.trace(moments) * np.eye(3) - moments)
        links.append((rounded(mass)[0], rounded(com), rounded(tensor)))
    return links


def lower(mass_matrix):
    return [mass_matrix[row, column] for row in range(7) for column in range(row + 1)]


def mass_matrix(model, data, q):
    upper = np.triu(pin.crba(model, data, q))
    return upper + np.triu(upper, 1).T


def panda_states():
    model = panda()
    data = model.createData()
    states = []
    for _ in range(10):
        q = np.array(rounded(rng.uniform(-3, 3, 7)))
        states.append({
            "q": q.tolist(),
            "mass_matrix": lower(mass_matrix(model, data, q)),
            "gravity": pin.computeGeneralizedGravity(model, data, q).tolist(),
        })
    return states


def random_robots(count):
    robots = []
    for index in range(count):
        links = random_links(0.5)
        armature = rounded(rng.uniform(0, 0.02, 7))
        damping = rounded(rng.uniform(0, 15, 7))
        gravity = 0.0 if index % 4 == 0 else 9.81
        q, qd, torque = (np.array(rounded(rng.uniform(-limit, limit, 7))) for limit in (3, 2.5, 20))
        model = arm(links, armature, gravity)
        data = model.createData()
        bias = pin.nonLinearEffects(model, data, q, qd)
        qdd = pin.aba(model, data, q, qd, torque - np.array(damping) * qd)
        m = mass_matrix(model, data, q)
        assert np.allclose(m @ qdd + bias + np.array(damping) * qd, torque, atol=1e-9)
        robots.append({
            "links": [[mass, *com, *tensor] for mass, com, tensor in links],
            "armature": armature, "damping": damping, "gravity": gravity,
            "q": q.tolist(), "qd": qd.tolist(), "torque": torque.tolist(),
            "mass_matrix": lower(m), "bias": bias.tolist(), "qdd": qdd.tolist(),
        })
    return robots


def chirp(t, c):
    offset, amplitude, f1, f2, depth, phase = np.array(c).T
    modulation = 1 + depth * np.cos(2 * np.pi * f2 * t)
    return offset + amplitude * np.cos(2 * np.pi * f1 * modulation * t + phase)


def multisine(t, c):
    amplitude, frequency = np.array(c)[:, :4], np.array(c)[:, 4:]
    angle = 2 * np.pi * frequency * t
    waves = [np.sin(angle[:, 0]), np.cos(angle[:, 1]), np.sin(angle[:, 2]), np.cos(angle[:, 3])]
    return (amplitude.T * np.array(waves)).sum(axis=0)


def integrate(model, damping, q, qd, law, coefficients, substeps):
    """Positions at 400 samples, 60 Hz, with the torque held and rounded to f32 as it is stored."""
    data = model.createData()
    h = 1 / 60 / substeps
    samples = []
    for k in range(400):
        samples.append(q.tolist())
        torque = law(k / 60, coefficients).astype(np.float32).astype(np.float64)
        slope = lambda q, qd: pin.aba(model, data, q, qd, torque - damping * qd).copy()
        for _ in range(substeps):
            a1 = slope(q, qd)
            v2 = qd + h / 2 * a1
            a2 = slope(q + h / 2 * qd, v2)
            v3 = qd + h / 2 * a2
            a3 = slope(q + h / 2 * v2, v3)
            v4 = qd + h * a3
            a4 = slope(q + h * v3, v4)
            q = q + h / 6 * (qd + 2 * v2 + 2 * v3 + v4)
            qd = qd + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    return np.array(samples)


def trajectories():
    result = []
    for family, gravity in [("chirp", 0.0), ("chirp", 9.81), ("multisine", 0.0), ("multisine", 9.81)]:
        links = random_links(0.1)
        armature, damping = [0.01] * 7, rounded(rng.uniform(9, 11, 7))
        q0 = np.array(rounded(np.array([0, 0, 0, -1.5708, 0, 1.8675, 0]) + rng.uniform(-0.25, 0.25, 7)))
        qd0 = np.array(rounded(rng.uniform(-1, 1, 7)))
        if family == "chirp":
            law = chirp
            low, high = [-0.25, -2, 0.1, 0.1, 0.25, -math.pi], [0.25, 2, 1.0, 1.0, 0.25, math.pi]
        else:
            law = multisine
            low, high = [-5] * 4 + [0.1] * 4, [5] * 4 + [0.6] * 4
        coefficients = [rounded(rng.uniform(low, high)) for _ in range(7)]
        model = arm(links, armature, gravity)
        q = integrate(model, np.array(damping), q0, qd0, law, coefficients, 60)
        half = integrate(model, np.array(damping), q0, qd0, law, coefficients, 30)
        print(f"{family}, gravity {gravity}: 30 and 60 substeps differ by {np.abs(q - half).max():.1e} rad")
        result.append({
            "family": family,
            "links": [[mass, *com, *tensor] for mass, com, tensor in links],
            "armature": armature, "damping": damping, "gravity": gravity,
            "q0": q0.tolist(), "qd0": qd0.tolist(), "coefficients": coefficients,
            # Every 21st sample, the last one included.
            "q": [rounded(sample, 12) for sample in q[::21]],
        })
    return result


OUTPUT.write_text(json.dumps({
    "pinocchio": pin.__version__,
    "panda": panda_states(),
    "robots": random_robots(200),
    "trajectories": trajectories(),
}, separators=(",", ":")).replace("},{", "},\n{") + "\n")
print(OUTPUT, OUTPUT.stat().st_size)
