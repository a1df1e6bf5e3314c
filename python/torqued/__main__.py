"""`python -m torqued` is `torqued` of the same environment."""

import os
import sys

from .program import find_binary

if __name__ == "__main__":
    program = find_binary()
    os.execv(program, [program, *sys.argv[1:]])
