import numpy as np
import pytest

from retrue.errors import FileError, InputError
from retrue.files.images import read_image
from retrue.files.png import write_png


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(5, 7), (5, 7, 3)])
def test_every_pixel_comes_back(tmp_path, shape, dtype):
    image = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, shape, dtype=dtype, endpoint=True)
    write_png(tmp_path / "picture.png", image)
    again = read_image(tmp_path / "picture.png")
    assert again.dtype == dtype
    assert np.array_equal(again, image)


@pytest.mark.parametrize(
    "image", [np.zeros((4, 4)), np.zeros((4, 4, 2), np.uint8), np.zeros((0, 4), np.uint8), np.zeros(4, np.uint8)]
)
def test_what_is_no_picture(tmp_path, image):
    with pytest.raises(InputError, match="picture: expected grey or RGB"):
        write_png(tmp_path / "picture.png", image)
    assert not list(tmp_path.iterdir())


def test_no_such_folder(tmp_path):
    with pytest.raises(FileError, match="cannot be written"):
        write_png(tmp_path / "no" / "picture.png", np.zeros((4, 4), np.uint8))
