import pytest

from retrue.acceptance.artefact import Artefact, Length, parse_artefact
from retrue.errors import InputError


def test_specs_are_read_with_units_and_uncertainties():
    assert parse_artefact("sphere:25.4mm") == Artefact("sphere", Length(25.4), None, "mm")
    bar = parse_artefact("spheres:1in+-0.0001in:15cm±2um")
    assert bar.distance.value == pytest.approx(5.905511811)
    assert bar.distance.expanded == pytest.approx(2e-6 / 0.0254)
    assert bar.converted("mm").diameter.value == pytest.approx(25.4)
    assert str(parse_artefact("spheres:25mm:150mm+-0.003mm")) == "spheres:25mm:150mm+-0.003mm"
    assert parse_artefact("plane").positions == 6


@pytest.mark.parametrize(
    ("spec", "said"),
    [
        ("cube:3mm", "expected sphere:DIAMETER"),
        ("sphere", "expected sphere:DIAMETER"),
        ("sphere:25", "found '25'"),
        ("sphere:0mm", "positive length"),
        ("sphere:1mm+-2mm", "uncertainty below its length"),
        ("spheres:25mm:20mm", "further apart than one diameter"),
        ("sphere:nanmm", "found 'nanmm'"),
        ("plane:3mm", "expected sphere:DIAMETER"),
    ],
)
def test_rubbish_is_refused(spec, said):
    with pytest.raises(InputError, match=said):
        parse_artefact(spec)
