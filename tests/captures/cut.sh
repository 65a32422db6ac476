#!/bin/sh
# Cuts the captures from the full recordings: cut.sh RECORDINGS (a directory with accuracy/ and calibration/).
# Needs gzip and awk. README.md says what the pieces are.
set -eu
from=$1
cd "$(dirname "$0")"

# cut_run RUN SHIFT "FROM-TO ...": keeps the frames and reference rows whose time from the log's first frame lies in
# one of the pieces, and takes SHIFT off the reference's times.
cut_run() {
    run=$1 shift_s=$2 pieces=$3
    mkdir -p "$run"
    cp "$from/$run/arm.toml" "$from/$run/arm_a.dbc" "$from/$run/arm_a.urdf" "$run/"
    chmod 644 "$run"/*
    keep='function kept(t,  i, ends) { for (i = 1; i <= n; i++) { split(piece[i], ends, "-"); if (t >= ends[1] && t < ends[2]) return 1 } return 0 }
          BEGIN { n = split(pieces, piece, " ") }'
    # Stamps have more digits than a double keeps apart: subtract seconds and fraction one by one.
    gzip -dc "$from/$run/can.log.gz" | awk -v pieces="$pieces" "$keep"'
        { split(substr($1, 2, length($1) - 2), s, "."); if (NR == 1) first = s[1] }
        kept(s[1] - first + ("0." s[2]))' | gzip -9n > "$run/can.log.gz"
    awk -F, -v OFS=, -v pieces="$pieces" -v shift_s="$shift_s" "$keep"'
        NR == 1 { print; next }
        kept($1) { $1 = sprintf("%.6f", $1 - shift_s); print }' "$from/$run/reference.csv" > "$run/reference.csv"
    cp "$from/$run/run.toml" "$run/run.toml"
    chmod 644 "$run"/*
}

# The log's first frame stays the first frame, so the times in run.toml and reference.csv keep their meaning; the last load interval ends
# with the last piece.
cut_run calibration 0 "0-14 326.6-340 650-664 975-989 1296.2-1310"
sed -i 's/^to = 1462.200$/to = 1310.000/' calibration/run.toml
# One piece out of the middle, from just before a round: a push, then motion. No load hangs anywhere in this run, so its
# run.toml needs no shift, only an end.
cut_run accuracy 62 "61.998-71.998"
sed -i 's/^to = .*/to = 10.000/' accuracy/run.toml
