"""The figure of docs/closed-loop.md: one arm of `panda-real`, its reference, its motion and its torques.

    pip install matplotlib polars
    echo '{"preset": "panda-real", "trajectories": 20}' | torqued simulate --spec - --out robots
    python docs/examples/closed_loop_figure.py robots docs/figures/closed-loop.svg
"""

import sys

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
import polars

DEGREES = 57.29577951308232
COLOURS = {2: "#0b6e4f", 4: "#c8553d"}


def main(folder, out):
    robots = polars.read_parquet(f"{folder}/robots-00000.parquet")
    robot = robots.filter(polars.col("family") == "point-to-point").row(0, named=True)
    rows = polars.read_parquet(f"{folder}/trajectories-00000.parquet")
    rows = rows.filter(polars.col("trajectory") == robot["trajectory"]).sort("step")
    time = rows["step"] / robot["rate_hz"]

    plt.rcParams.update({"font.size": 9, "svg.hashsalt": "torqued", "axes.spines.top": False, "axes.spines.right": False})
    figure, (motion, error, torque) = plt.subplots(1, 3, figsize=(10, 2.8), layout="constrained")
    for joint, colour in COLOURS.items():
        r, q, u = (rows[f"{name}{joint}"] for name in "rqu")
        motion.plot(time, r * DEGREES, "--", color="black", lw=0.8)
        motion.plot(time, q * DEGREES, color=colour, lw=1.4, label=f"joint {joint}")
        error.plot(time, (q - r) * DEGREES, color=colour, lw=1.4)
        torque.plot(time, u, color=colour, lw=1.4)
    motion.set_title("references (dashed) and positions, °", fontsize=9)
    error.set_title("positions minus references, °", fontsize=9)
    torque.set_title("torques, N·m", fontsize=9)
    motion.legend(frameon=False)
    for axes in (motion, error, torque):
        axes.set_xlabel("s")
    figure.savefig(out, metadata={"Date": None})


if __name__ == "__main__":
    main(*sys.argv[1:])
