import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skfem_peridynamics.app.scene.formula import Formula, FormulaError

X = np.array([[0.5, 1.0, -2.0], [3.0, 0.25, 1.0]])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1.5e3", 1500.0),
        (2, 2.0),
        (".5", 0.5),
        ("x + 2*y", X[0] + 2 * X[1]),
        ("x - y - 1", X[0] - X[1] - 1),
        ("12 / 3 / 2", 2.0),
        ("2 ^ 3 ^ 2", 512.0),
        ("-2 ** 2", -4.0),
        ("2 ** -1", 0.5),
        ("-x^2", -(X[0] ** 2)),
        ("(x + y) * t", (X[0] + X[1]) * 0.25),
        ("sin(pi*x) + cos(0)", np.sin(np.pi * X[0]) + 1),
        ("min(x, y) + max(x, y)", X[0] + X[1]),
        ("step(x) * (y > 0.5)", (X[0] >= 0) * (X[1] > 0.5)),
        ("x <= 0.5", X[0] <= 0.5),
        ("e^(-x)", np.exp(-X[0])),
        ("abs(x) + sqrt(y) + tanh(x) + log(e)", np.abs(X[0]) + np.sqrt(X[1]) + np.tanh(X[0]) + 1),
    ],
)
def test_arithmetic(text, expected):
    assert Formula(text)(X, t=0.25) == pytest.approx(np.broadcast_to(expected, (3,)).astype(float), rel=1e-14)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("x +", "ends too early"),
        ("x y", "'y' was not expected there"),
        ("(x", r"'\)' was expected, not the end"),
        ("sin x", r"'\(' was expected, not 'x'"),
        ("min(x)", "',' was expected"),
        ("__import__(x)", "'__import__' is not a name it knows"),
        ("os.system(x)", "'.' is not part of arithmetic"),
        ("x; y", "';' is not part of arithmetic"),
        ("lambda x", "'lambda' is not a name"),
        ("x < y < 1", "'<' was not expected"),
        ("1e", "'e' was not expected there"),
        ("(" * 60 + "x" + ")" * 60, "nested deeper than 50"),
        ("-" * 60 + "x", "nested deeper than 50"),
        ("x" * 3000, "3000 characters is longer than 2000"),
    ],
)
def test_what_the_grammar_does_not_know(text, message):
    with pytest.raises(FormulaError, match=message):
        Formula(text)


def test_values_that_are_not_finite_are_placed():
    with pytest.raises(FormulaError, match=r"'1/\(x - 1\)' is inf at x = 1, y = 0.25, t = 3"):
        Formula("1/(x - 1)")(X, t=3.0)
    with pytest.raises(FormulaError, match="uses z, but the body has 2 dimensions"):
        Formula("z")(X)


def test_it_knows_what_it_depends_on():
    assert Formula("2 * sin(t)").uses("t")
    assert not Formula("x + y").uses("t")
    assert Formula("x").uses("x", "y")


@settings(max_examples=300, deadline=None)
@given(st.text(alphabet="xyzt0123456789.+-*/^()<>=, sincoexpmabqr_e[]'\"\\;", max_size=40))
def test_any_text_is_a_number_or_a_formula_error(text):
    try:
        value = Formula(text)(X, t=1.0)
    except FormulaError:
        return
    assert value.shape == (3,)
    assert np.isfinite(value).all()
