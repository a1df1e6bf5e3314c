"""Writes reference numbers for tests of the dynamics, computed with Pinocchio.

    python3 -m venv /tmp/pinocchio && /tmp/pinocchio/bin/pip install pin==4.1.0
    /tmp/pinocchio/bin/python crates/dynamics/tests/peers/pinocchio_reference.py

Nothing here is shared with the Rust code: the arm is entered again from its sources, Pinocchio welds the bodies,
and Pinocchio's articulated-body algorithm integrates the trajectories.
"""

import json
import math
from pathlib import Path

import numpy as np
import pinocchio as pin

DATA = Path(__file__).parents[1] / "data"
# Whole trajectories, and states of the nominal arm.
OUTPUT = DATA / "pinocchio.json"
# Random robots, each 134 inputs as little-endian f32 and then 42 results as f64, in the order of `random_robots`.
ROBOTS = DATA / "pinocchio_robots.bin"

# Modified Denavit-Hartenberg rows a, alpha, d (Gaz et al. 2019).
DENAVIT_HARTENBERG = [
    (0, 0, 0.333), (0, -90, 0), (0, 90, 0.316), (0.0825, 90, 0), (-0.0825, -90, 0.384), (0, 90, 0), (0.088, 90, 0),
]
FLANGE = 0.107
# Gaz et al. 2019, table IV.
FRICTION = [
    [0.54615, 0.87224, 0.64068, 1.2794, 0.83904, 0.30301, 0.56489],
    [5.1181, 9.0657, 10.136, 5.5903, 8.3469, 17.133, 10.336],
    [0.039533, 0.025882, -0.04607, 0.036194, 0.026226, -0.021047, 0.0035526],
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


def scaled_lengths(spread):
    """The lengths a4, a5, a7, d1, d3, d5 and the flange's, each drawn around the Panda's."""
    return np.array([0.0825, -0.0825, 0.088, 0.333, 0.316, 0.384, FLANGE]) * rng.uniform(1 - spread, 1 + spread, 7)


NOMINAL = scaled_lengths(0)


def arm(links, armature, gravity, lengths=NOMINAL):
    """A Panda-shaped arm; `links` are (mass, com, inertia) tuples."""
    a4, a5, a7, d1, d3, d5, _ = lengths
    rows = zip([0, 0, 0, a4, a5, 0, a7], [row[1] for row in DENAVIT_HARTENBERG], [d1, 0, d3, 0, d5, 0, 0])
    model = pin.Model()
    joint = 0
    for index, (a, alpha, d) in enumerate(rows):
        turn = pin.SE3(pin.rpy.rpyToMatrix(math.radians(alpha), 0, 0), np.zeros(3))
        placement = turn * pin.SE3(np.eye(3), np.array([a, 0, d]))
        joint = model.addJoint(joint, pin.JointModelRZ(), placement, f"joint{index + 1}")
        model.appendBodyToJoint(joint, inertia(links[index]), pin.SE3.Identity())
    model.armature = np.array(armature)
    model.gravity.linear = np.array([0, 0, -gravity])
    return model


def panda(lengths=NOMINAL, payload=None):
    """The arm with hand and fingers; `payload` is mass, centre in the hand's frame and radius of a sphere."""
    model = arm(LINKS, [0.01] * 7, 9.81, lengths)
    hand = pin.SE3(pin.rpy.rpyToMatrix(0, 0, -math.pi / 4), np.array([0, 0, lengths[6]]))
    model.addFrame(pin.Frame("hand", 7, 0, hand, pin.FrameType.OP_FRAME))
    if payload is not None:
        mass, center, radius = payload
        sphere = pin.Inertia.FromSphere(mass, radius)
        model.appendBodyToJoint(7, sphere, hand * pin.SE3(np.eye(3), np.array(center)))
    model.appendBodyToJoint(7, inertia(physical(HAND)), hand)
    model.appendBodyToJoint(7, inertia(FINGER), hand * pin.SE3(np.eye(3), np.array([0, 0.04, 0.0584])))
    model.appendBodyToJoint(7, inertia(MIRRORED_FINGER), hand * pin.SE3(np.eye(3), np.array([0, -0.04, 0.0584])))
    return model


def rounded(values, digits=7):
    """Rounds inputs to a few digits before use, so that both sides use the same numbers."""
    return [float(f"{value:.{digits}g}") for value in np.ravel(values)]


def random_links(spread):
    """Random links: masses and centres around the Panda's, with second moments of its size along random axes."""
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


def panda_states(count, spread, loaded):
    states = []
    for _ in range(count):
        lengths = np.array(rounded(scaled_lengths(spread)))
        payload = (rounded(rng.uniform(0.1, 3))[0], rounded(rng.uniform(-0.1, 0.1, 3)), rounded(rng.uniform(0.01, 0.1))[0])
        model = panda(lengths, payload if loaded else None)
        data = model.createData()
        q = np.array(rounded(rng.uniform(-3, 3, 7)))
        state = {
            "lengths": lengths.tolist(),
            "payload": [payload[0], *payload[1], payload[2]] if loaded else None,
            "q": q.tolist(),
            "mass_matrix": lower(mass_matrix(model, data, q)),
            "gravity": pin.computeGeneralizedGravity(model, data, q).tolist(),
        }
        pin.framesForwardKinematics(model, data, q)
        state["pose"] = pin.SE3ToXYZQUAT(data.oMf[model.getFrameId("hand")]).tolist()
        states.append(state)
    return states


def sigmoid_friction(phi, qd):
    phi1, phi2, phi3 = np.array(phi)
    return phi1 / (1 + np.exp(-phi2 * (qd + phi3))) - phi1 / (1 + np.exp(-phi2 * phi3))


def random_robots(count):
    records = []
    for index in range(count):
        single = lambda values: np.array(values, dtype=np.float32)
        exact = lambda values: values.astype(np.float64)
        links = [single([mass, *com, *tensor]) for mass, com, tensor in random_links(0.5)]
        lengths = single(scaled_lengths(0.5))
        armature, damping = single(rng.uniform(0, 0.02, 7)), single(rng.uniform(0, 15, 7))
        gravity = single([0.0 if index % 4 == 0 else 9.81])
        phi = single(FRICTION) * single(rng.uniform(0.5, 1.5, (3, 7))) * (0 if index % 2 == 0 else 1)
        q, qd, torque = (single(rng.uniform(-limit, limit, 7)) for limit in (3, 2.5, 20))

        bodies = [(body[0], body[1:4], body[4:]) for body in map(exact, links)]
        model = arm(bodies, exact(armature), float(gravity[0]), exact(lengths))
        data = model.createData()
        position, velocity = exact(q), exact(qd)
        resistance = exact(damping) * velocity + sigmoid_friction(exact(phi), velocity)
        bias = pin.nonLinearEffects(model, data, position, velocity)
        qdd = pin.aba(model, data, position, velocity, exact(torque) - resistance)
        m = mass_matrix(model, data, position)
        assert np.allclose(m @ qdd + bias + resistance, torque, atol=1e-9)
        inputs = [*links, lengths, armature, damping, gravity, phi.ravel(), q, qd, torque]
        records.append(np.concatenate(inputs).astype("<f4").tobytes())
        records.append(np.concatenate([lower(m), bias, qdd]).astype("<f8").tobytes())
    return b"".join(records)


def chirp(t, c):
    offset, amplitude, f1, f2, depth, phase = np.array(c).T
    modulation = 1 + depth * np.cos(2 * np.pi * f2 * t)
    return offset + amplitude * np.cos(2 * np.pi * f1 * modulation * t + phase)


def multisine(t, c):
    amplitude, frequency = np.array(c)[:, :4], np.array(c)[:, 4:]
    angle = 2 * np.pi * frequency * t
    waves = [np.sin(angle[:, 0]), np.cos(angle[:, 1]), np.sin(angle[:, 2]), np.cos(angle[:, 3])]
    return (amplitude.T * np.array(waves)).sum(axis=0)


def integrate(model, damping, phi, compensated, q, qd, law, coefficients, substeps):
    """Positions at 400 samples, 60 Hz. The torque is held, and rounded to f32 as in the stored file."""
    data = model.createData()
    h = 1 / 60 / substeps
    samples = []
    for k in range(400):
        samples.append(q.tolist())
        torque = law(k / 60, coefficients)
        if compensated:
            torque = torque + pin.computeGeneralizedGravity(model, data, q)
        torque = torque.astype(np.float32).astype(np.float64)

        def slope(q, qd):
            friction = 0 if phi is None else sigmoid_friction(phi, qd)
            return pin.aba(model, data, q, qd, torque - damping * qd - friction).copy()

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
    cases = [
        ("chirp", "off", None), ("chirp", "on", None), ("multisine", "off", None), ("multisine", "on", None),
        ("chirp", "compensated", None), ("multisine", "compensated", FRICTION), ("chirp", "on", FRICTION),
    ]
    for family, gravity, phi in cases:
        links = random_links(0.1)
        lengths = rounded(scaled_lengths(0.1))
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
        model = arm(links, armature, 0.0 if gravity == "off" else 9.81, lengths)
        run = lambda substeps: integrate(
            model, np.array(damping), phi, gravity == "compensated", q0, qd0, law, coefficients, substeps
        )
        q = run(60)
        print(f"{family}, gravity {gravity}: 30 and 60 substeps differ by {np.abs(q - run(30)).max():.1e} rad")
        result.append({
            "family": family, "gravity": gravity,
            "links": [[mass, *com, *tensor] for mass, com, tensor in links],
            "lengths": lengths, "armature": armature, "damping": damping, "friction": phi,
            "q0": q0.tolist(), "qd0": qd0.tolist(), "coefficients": coefficients,
            # Every 21st sample, the last one included.
            "q": [rounded(sample, 12) for sample in q[::21]],
        })
    return result


OUTPUT.write_text(json.dumps({
    "pinocchio": pin.__version__,
    "panda": panda_states(10, 0, False) + panda_states(10, 0.3, True),
    "trajectories": trajectories(),
}, separators=(",", ":")).replace("},{", "},\n{") + "\n")
ROBOTS.write_bytes(random_robots(1024))
for path in (OUTPUT, ROBOTS):
    print(path.name, path.stat().st_size)
