"""Writes arm.urdf, monday.csv, tuesday.csv and loaded.csv for docs/guides/urdf.md: a lab's arm of two joints and its logs.

    python docs/examples/my_arm.py

The URDF is what a designer knows. The logs are of the arm as it was built: other masses and centres, rotors, friction. They have 125 rows per second
for 60 s. Positions have the noise of an encoder. Torques have the noise of a sensor and are written down 12 ms late. In loaded.csv the hand holds 1.2 kg, whose
centre is 4 cm before the hand.
"""

import math
import random

RATE_HZ, SECONDS, DELAY_S = 125, 60, 0.012
ENCODER_RAD, SENSOR_NM = 2e-5, 0.05
G, UPPER_ARM_M, FOREARM_M = 9.81, 0.4, 0.3
# Mass, distance of the centre from the joint, inertia about the centre; Coulomb and viscous friction, rotor inertia.
BUILT = [(3.24, 0.195, 0.045), (1.47, 0.128, 0.013)]
JOINTS = [(1.2, 2.5, 0.15), (0.6, 1.0, 0.06)]
FRICTION_SPEED_RAD_S = 0.04
LOAD_KG, LOAD_M = 1.2, 0.04

URDF = """<?xml version="1.0"?>
<robot name="my-arm">
  <link name="stand"/>
  <joint name="shoulder" type="revolute">
    <parent link="stand"/><child link="upper_arm"/>
    <origin xyz="0 0 0.5"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="40" velocity="4"/>
  </joint>
  <link name="upper_arm">
    <inertial><origin xyz="0.18 0 0"/><mass value="3.0"/><inertia ixx="0.004" ixy="0" ixz="0" iyy="0.04" iyz="0" izz="0.04"/></inertial>
  </link>
  <joint name="elbow" type="revolute">
    <parent link="upper_arm"/><child link="forearm"/>
    <origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-2.8" upper="2.8" effort="20" velocity="6"/>
  </joint>
  <link name="forearm">
    <inertial><origin xyz="0.14 0 0"/><mass value="1.6"/><inertia ixx="0.002" ixy="0" ixz="0" iyy="0.012" iyz="0" izz="0.012"/></inertial>
  </link>
  <joint name="flange" type="fixed">
    <parent link="forearm"/><child link="hand"/><origin xyz="0.3 0 0"/>
  </joint>
  <link name="hand"/>
</robot>
"""


def torques(q, qd, qdd, load_kg):
    """What the motors do in a state, N·m: the equation of motion of two links in a vertical plane."""
    (m1, r1, i1), (m2, r2, i2) = BUILT
    reach = FOREARM_M + LOAD_M
    mass = m2 + load_kg
    moment = m2 * r2 + load_kg * reach
    inertia = i2 + m2 * r2**2 + load_kg * reach**2
    upper = i1 + m1 * r1**2 + mass * UPPER_ARM_M**2
    coupling = UPPER_ARM_M * moment * math.cos(q[1])
    centrifugal = UPPER_ARM_M * moment * math.sin(q[1])
    weight = moment * G * math.cos(q[0] + q[1])
    of_links = [
        (upper + inertia + 2 * coupling) * qdd[0]
        + (inertia + coupling) * qdd[1]
        - centrifugal * (2 * qd[0] * qd[1] + qd[1] ** 2)
        - (m1 * r1 + mass * UPPER_ARM_M) * G * math.cos(q[0])
        - weight,
        (inertia + coupling) * qdd[0] + inertia * qdd[1] + centrifugal * qd[0] ** 2 - weight,
    ]
    return [
        tau + coulomb * math.tanh(v / FRICTION_SPEED_RAD_S) + viscous * v + rotor * a
        for tau, v, a, (coulomb, viscous, rotor) in zip(of_links, qd, qdd, JOINTS)
    ]


def write(name, seed, load_kg=0.0):
    """A log of a sum of sines in each joint."""
    numbers = random.Random(seed)
    centers = (-0.6, 0.8)
    waves = [
        [(numbers.uniform(0.5, 1.0) * 0.6 / n, 0.08 * n, numbers.uniform(0, math.tau)) for n in range(1, 7)] for _ in centers
    ]

    def motion(t, order):
        def of(center, waves):
            turned = lambda hz, phase: math.tau * hz * t + phase + order * math.pi / 2
            return (center if order == 0 else 0) + sum(
                a * (math.tau * hz) ** order * math.sin(turned(hz, phase)) for a, hz, phase in waves
            )

        return [of(center, waves) for center, waves in zip(centers, waves)]

    with open(name, "w") as log:
        print("stamp,tau_1,tau_2,pos_1,pos_2", file=log)
        for row in range(SECONDS * RATE_HZ):
            t = row / RATE_HZ
            u = torques(*(motion(t - DELAY_S, order) for order in range(3)), load_kg)
            u = [value + numbers.gauss(0, SENSOR_NM) for value in u]
            q = [value + numbers.gauss(0, ENCODER_RAD) for value in motion(t, 0)]
            print(f"{t:.3f}", *(f"{value:.4f}" for value in u), *(f"{value:.6f}" for value in q), sep=",", file=log)


def main():
    with open("arm.urdf", "w") as file:
        file.write(URDF)
    write("monday.csv", seed=1)
    write("tuesday.csv", seed=2)
    write("loaded.csv", seed=3, load_kg=LOAD_KG)


if __name__ == "__main__":
    main()
