#!/bin/sh
# A minute of coverage-guided fuzzing for each reader; what breaks one is kept in fuzz/found. SECONDS_EACH and PYTHON may be set.
set -eu
cd "$(dirname "$0")"
python=${PYTHON:-../.venv/bin/python}
mkdir -p found
status=0
for target in $("$python" -c 'from targets import TARGETS; print(*TARGETS)'); do
    mkdir -p "corpus/$target"
    echo "== $target"
    CORPUS="corpus/$target" "$python" fuzz.py "$target" -max_total_time="${SECONDS_EACH:-60}" \
        -artifact_prefix="found/$target-" -print_final_stats=1 -verbosity=0 || status=1
done
exit $status
