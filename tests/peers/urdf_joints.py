"""Prints where a URDF lies, or its joints as numbers for aba_rates.cpp: one joint a line.

    python tests/peers/urdf_joints.py path|joints URDF

URDF is a path below the robots of example-robot-data. All of its joints must turn about x, y or z. A line has the axis (0, 1 or 2), the rotation
of the placement by rows and its translation, the mass, the centre, and the inertia about it in the order of Pinocchio.
"""

import pathlib
import sys

import pinocchio


def main():
    what, urdf = sys.argv[1:]
    path = next(
        robots / urdf
        for folder in map(pathlib.Path, sys.path)
        if (robots := folder / "cmeel.prefix/share/example-robot-data/robots").is_dir()
    )
    if what == "path":
        print(path)
        return
    model = pinocchio.buildModelFromUrdf(str(path))
    for joint, placement, inertia in zip(model.joints[1:], model.jointPlacements[1:], model.inertias[1:]):
        axis = "XYZ".index(joint.shortname().removeprefix("JointModelR"))
        about = inertia.inertia
        numbers = [*placement.rotation.ravel(), *placement.translation, inertia.mass, *inertia.lever]
        numbers += [about[at] for at in [(0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)]]
        print(axis, *(repr(float(number)) for number in numbers))


if __name__ == "__main__":
    main()
