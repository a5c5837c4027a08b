"""Numbers of a key end where the key's type does."""

from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from trackbench import field_types

TINY, HUGE = 5e-324, 1.7976931348623157e308
INF, NAN = float("inf"), float("nan")


@pytest.mark.parametrize(
    ("kind", "taken", "refused"),
    [
        ("Positive", (TINY, HUGE), (0.0, -TINY, INF, NAN)),
        ("NonNegative", (0.0, HUGE), (-TINY, INF, NAN)),
        ("Finite", (-HUGE, HUGE), (-INF, INF, NAN)),
        ("Share", (0.0, 1.0), (-TINY, 1.0 + 2**-52, NAN)),
        ("OpenShare", (TINY, 1.0 - 2**-53), (0.0, 1.0, NAN)),
        ("Count", (1, 10**15), (0, 10**15 + 1, 1.5)),
        ("Steps", (1, 100_000), (0, 100_001)),
        ("Natural", (0,), (-1,)),
        ("Digits", (1, 15), (0, 16)),
    ],
)
def test_numbers_of_a_key_end_where_their_type_does(kind: str, taken: Any, refused: Any) -> None:
    validator = TypeAdapter(getattr(field_types, kind))
    assert [validator.validate_python(x) for x in taken] == [*taken]
    for x in refused:
        with pytest.raises(ValidationError):
            validator.validate_python(x)
    assert [field_types.is_number(x) for x in (0, 0.5, True, "1")] == [True, True, False, False]
