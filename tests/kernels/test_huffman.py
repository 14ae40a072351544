"""The codes of a scan lead as far compiled as plain, in whole pictures and in damaged ones."""

import cv2
import numpy as np
import pytest

from retrue import kernels
from retrue.files.jpeg import whole_scans
from retrue.kernels import huffman
from tests.kernels.plain import plain


@pytest.mark.parametrize("interval", [0, 2])
def test_codes_lead_as_far_compiled_as_plain(monkeypatch: pytest.MonkeyPatch, interval: int) -> None:
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 256, (40, 50, 3), dtype=np.uint8)
    content = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_RST_INTERVAL, interval])[1].tobytes()
    uncompiled, found = plain("huffman"), []

    def both(*arguments: object) -> int:
        end = huffman.codes_end(*arguments)
        assert uncompiled.codes_end(memoryview(arguments[0]), *arguments[1:]) == end
        found.append(end)
        return end

    monkeypatch.setattr(kernels, "huffman", type("Both", (), {"codes_end": staticmethod(both)}))
    assert whole_scans(content, 500) == 1
    for place in rng.integers(len(content) // 2, len(content) - 20, 10).tolist():
        whole_scans(content[:place] + content[place + 9 :], 500)
    assert found[0] == len(content) - 2
    assert -1 in found
