"""The codes of a scan lead as far compiled as plain, in whole pictures and in damaged ones."""

import cv2
import numpy as np
import pytest

from retrue.files import jpeg_scan
from retrue.kernels import huffman
from tests.kernels.plain import plain


@pytest.mark.parametrize("interval", [0, 2])
def test_codes_lead_as_far_compiled_as_plain(monkeypatch: pytest.MonkeyPatch, interval: int) -> None:
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 256, (40, 50, 3), dtype=np.uint8)
    content = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_RST_INTERVAL, interval])[1].tobytes()
    uncompiled, found = plain("huffman"), []

    def both(*arguments: object) -> int:
        left = huffman.bytes_left(*arguments)
        assert uncompiled.bytes_left(memoryview(arguments[0]), *arguments[1:]) == left
        found.append(left)
        return left

    monkeypatch.setattr(jpeg_scan, "huffman", type("Both", (), {"bytes_left": staticmethod(both)}))
    assert jpeg_scan.pixels_are_whole(content)
    for place in rng.integers(len(content) // 2, len(content) - 20, 10).tolist():
        jpeg_scan.pixels_are_whole(content[:place] + content[place + 9 :])
    assert found[0] == 0
    assert -1 in found
