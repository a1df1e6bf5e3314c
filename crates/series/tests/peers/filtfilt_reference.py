"""Numbers of scipy.signal.filtfilt for crates/series/src/smoothing/low_pass.rs.

    pip install numpy scipy
    python crates/series/tests/peers/filtfilt_reference.py > crates/series/tests/data/filtfilt.json
"""

import json

import numpy as np
import scipy
from scipy.signal import butter, filtfilt

generator = np.random.default_rng(4)
steps = np.arange(80)
series = 0.4 * np.sin(0.11 * steps) + 0.01 * steps + 0.05 * generator.standard_normal(80)

filtered = []
for edge_hz, rate_hz in [(2.0, 60.0), (7.5, 60.0), (24.0, 60.0), (12.0, 500.0)]:
    b, a = butter(4, edge_hz, fs=rate_hz)
    values = filtfilt(b, a, series)
    filtered.append({"edge_hz": edge_hz, "rate_hz": rate_hz, "values": values.tolist()})

print(json.dumps({"scipy": scipy.__version__, "series": series.tolist(), "filtered": filtered}))
