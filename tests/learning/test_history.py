from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from exosight.errors import DataError
from exosight.learning.history import HISTORY_NAME, EpochRecord, read_history, write_history

number = st.floats(allow_nan=False, allow_infinity=False)


records = st.builds(EpochRecord, st.integers(1), st.integers(0), number, number, number, number, number)


@given(st.lists(records))
def test_history_reads_back_to_the_last_digit(
    tmp_path_factory: pytest.TempPathFactory, history: list[EpochRecord]
):
    folder = tmp_path_factory.mktemp("history")
    history = [*history, EpochRecord(1, 2, 0.1, 1e-300, None, None, 5.0)]
    write_history(folder, history)
    assert read_history(folder) == tuple(history)
    assert [path.name for path in folder.iterdir()] == [HISTORY_NAME]


COLUMNS = b"epoch,step,learning_rate,train_loss,validation_loss,validation_l1,seconds\n"


@pytest.mark.parametrize(
    "content",
    [b"epoch,step\n1,2\n", b"\xff\xfe\x00", COLUMNS + b"1,2,nan,1,1,1,1\n", COLUMNS + b"1,2,1,1,1,1\n"],
)
def test_another_table_is_refused(tmp_path: Path, content: bytes):
    (tmp_path / HISTORY_NAME).write_bytes(content)
    with pytest.raises(DataError, match=HISTORY_NAME):
        read_history(tmp_path)


def test_missing_history_is_refused(tmp_path: Path):
    with pytest.raises(DataError, match="cannot be read"):
        read_history(tmp_path)
