"""Parses a page of metrics with Prometheus' own client library: metrics.py FILE prints each family, then each sample."""

import sys

from prometheus_client.parser import text_string_to_metric_families

with open(sys.argv[1], encoding="utf-8") as file:
    text = file.read()
for family in text_string_to_metric_families(text):
    assert family.documentation, f"{family.name} has no help"
    assert family.type != "unknown", f"{family.name} has no type"
    print("family", family.name, family.type)
    for sample in family.samples:
        labels = ",".join(f"{key}={value}" for key, value in sorted(sample.labels.items()))
        print("sample", sample.name, labels or "-", float(sample.value))
