"""Peer of the linear stage: numpy's lstsq. numpy_lstsq.py FILE ROWS COLUMNS GAUGES: seconds for as many least squares."""

import sys
import time

import numpy

path, rows, columns, gauges = sys.argv[1], *map(int, sys.argv[2:])
table = numpy.fromfile(path).reshape(rows, columns + 1)
a, z = numpy.ascontiguousarray(table[:, :columns]), table[:, columns].copy()
begun = time.perf_counter()
total = sum(numpy.linalg.lstsq(a, z, rcond=None)[0][-1] for _ in range(gauges))
print(time.perf_counter() - begun, total / gauges)
