import pytest

from schemas.names import is_name


@pytest.mark.parametrize("name", ["bolt", "bolt-0", "a.b", "_x", "größe", "1"])
def test_names(name):
    assert is_name(name)


@pytest.mark.parametrize("text", ["", ".", "..", "/abs", "a/b", "../a", "-a", ".hidden", "a b", "a\n", "a\0", None, 3])
def test_no_names(text):
    assert not is_name(text)
