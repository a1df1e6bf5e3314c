"""Finds the program that was installed with this package."""

import os
import pathlib
import shutil
import sysconfig

NAME = "torqued"


def find_binary():
    """The path of the program `torqued`.

    It searches the places where pip installs programs: those of this environment, beside a package of `pip install
    --target`, and those of the user. The PATH comes last.

    Raises FileNotFoundError if there is none.
    """
    places = list(_places())
    for place in places:
        program = place / NAME
        if program.is_file() and os.access(program, os.X_OK):
            return str(program)
    if found := shutil.which(NAME):
        return found
    looked = ", ".join(str(place) for place in places)
    raise FileNotFoundError(f"there is no program {NAME!r} in {looked}, or on the PATH")


def _places():
    yield pathlib.Path(sysconfig.get_path("scripts"))
    packages = pathlib.Path(__file__).resolve().parent.parent
    yield packages / "bin"
    yield pathlib.Path(sysconfig.get_path("scripts", scheme=sysconfig.get_preferred_scheme("user")))
