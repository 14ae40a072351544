#!/bin/sh
# Decodes a picture and verifies a rig with the aarch64 wheel, on this machine by qemu, and compares with the native result.
# On Debian, as root; needs `make wheels` and a network:  benchmarks/aarch64.sh [PYTHON, with the package installed]
set -eu
cd "$(dirname "$0")/.."
python=${1:-.venv/bin/python} renders=$PWD/tests/data/renders work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
command -v qemu-aarch64-static >/dev/null || (apt-get update -qq && apt-get install -qq --yes --no-install-recommends qemu-user-static)

# Debian's own Python for aarch64, unpacked beside the system, which stays as it is.
mkdir -p "$work/lists/partial" "$work/cache/archives/partial" "$work/debs" "$work/root" "$work/site"
touch "$work/status"
arm() {
	apt-get -qq -o APT::Architecture=arm64 -o APT::Architectures=arm64 -o Dir::State::Lists="$work/lists" \
		-o Dir::Cache="$work/cache" -o Dir::State::status="$work/status" -o APT::Sandbox::User=root "$@"
}
arm update
(cd "$work/debs" && arm download python3.11-minimal libpython3.11-minimal libpython3.11-stdlib libc6 libgcc-s1 libstdc++6 \
	zlib1g libexpat1 libffi8 libssl3 libbz2-1.0 liblzma5 libuuid1 libcrypt1 media-types)
for deb in "$work"/debs/*.deb; do dpkg -x "$deb" "$work/root"; done

"$python" -m pip install --quiet --target "$work/site" --only-binary=:all: --python-version 3.11 --implementation cp \
	--platform manylinux2014_aarch64 --platform manylinux_2_17_aarch64 --platform manylinux_2_27_aarch64 --platform manylinux_2_28_aarch64 dist/*_aarch64.whl

cat >"$work/decode.py" <<'PYTHON'
import platform
import sys
from pathlib import Path

sys.path[:0] = sys.argv[3:]
import retrue

renders, out = Path(sys.argv[1]), Path(sys.argv[2])
points = retrue.decode(retrue.read_pattern(renders / "pattern.json"), retrue.read_image(renders / "wall_objects_0.png"))
retrue.write_points(out, points)
rig = retrue.read_rig(renders / "wall_objects_0.rig.json")
print(platform.machine(), len(points), "points, the rig is", retrue.verify(rig, [points]).verdict)
PYTHON
"$python" "$work/decode.py" "$renders" "$work/native.csv"
qemu-aarch64-static -E OPENBLAS_NUM_THREADS=1 -L "$work/root" "$work/root/usr/bin/python3.11" -S "$work/decode.py" \
	"$renders" "$work/aarch64.csv" "$work/site"
"$python" - "$work/native.csv" "$work/aarch64.csv" <<'PYTHON'
import sys

import numpy as np

import retrue

native, other = map(retrue.read_points, sys.argv[1:])
assert len(native) == len(other) and np.array_equal(native.projector_px, other.projector_px)
print(f"the same points, {np.abs(native.camera_px - other.camera_px).max():.1e} px apart at most")
PYTHON
