"""Tables of errors that an evaluation prints and that documents show."""

import re

NUMBER = re.compile(r"\d+(?:\.\d+)?")


class Table:
    """The first table of errors in a text: its caption, its columns, and its rows by predictor.

    A row has its means and interval bounds in order, and the text in the column `prior knowledge`.
    """

    def __init__(self, text):
        lines = text.splitlines()
        start = next(k for k, line in enumerate(lines) if line == "RMSE in degrees, with 95 % intervals")
        self.caption = lines[start]
        self.columns = re.split(r" {2,}", lines[start + 2].strip())
        self.rows = {}
        for line in lines[start + 3 :]:
            if not line.strip():
                break
            name, *cells, knows = re.split(r" {2,}", line)
            self.rows[name] = ([float(number) for cell in cells for number in NUMBER.findall(cell)], knows)


def differences(documented, printed, tolerances):
    """Describes the differences between the documented table and the printed one. The printed one may have more rows.

    `tolerances` maps predictors to the relative tolerance of their rows. All other rows must agree in all digits.
    """
    found = []
    for what in ("caption", "columns"):
        if getattr(documented, what) != getattr(printed, what):
            found.append(f"{what}: {getattr(documented, what)!r} is printed as {getattr(printed, what)!r}")
    for name, (numbers, knows) in documented.rows.items():
        if name not in printed.rows:
            found.append(f"{name} is not printed")
            continue
        printed_numbers, printed_knows = printed.rows[name]
        if knows != printed_knows:
            found.append(f"{name} knows {knows!r}, printed as {printed_knows!r}")
        tolerance = tolerances.get(name, 0.0)
        is_close = len(numbers) == len(printed_numbers) and all(
            abs(number - other) <= tolerance * other for number, other in zip(numbers, printed_numbers)
        )
        if not is_close:
            found.append(f"{name}: {numbers} is printed as {printed_numbers}")
    return found
