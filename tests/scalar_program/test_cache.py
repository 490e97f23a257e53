"""Programs on disk: found again by what they compute, and made anew where they are damaged."""

from collections.abc import Callable, Iterator
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from exosight.scalar_program import cache, unroll
from exosight.scalar_program.function import Unrolled

X = np.array([0.3, -0.7, 0.2])


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Where programs are kept."""
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    monkeypatch.setattr(cache, "FOLDER", "kept")
    yield tmp_path / "kept"
    jax.config.update("jax_compilation_cache_dir", before)


def unrolled(function: Callable) -> Unrolled:
    return unroll(lambda at: (function(*at),), [(X,)])


def value(function: Callable) -> np.ndarray:
    return np.asarray(unrolled(function)(0, None, (X,))[0])


def test_a_program_is_found_again(folder: Path) -> None:
    def twice(x: jax.Array) -> jax.Array:
        return jnp.sin(x) @ x * jnp.arange(1.0, 4.0)

    np.testing.assert_allclose(value(twice), twice(X), rtol=1e-15)
    (file,) = folder.iterdir()
    written = file.stat().st_mtime_ns
    np.testing.assert_allclose(value(lambda y: twice(y)), twice(X), rtol=1e-15)
    assert [each.stat().st_mtime_ns for each in folder.iterdir()] == [written]


def test_functions_that_differ_a_little_have_names_of_their_own() -> None:
    functions = [
        lambda x: 1 - x,
        lambda x: x - 1,
        lambda x: x - 2,
        lambda x: x[::-1],
        lambda x: x[jnp.array([0, 0, 1])],
        lambda x: x[jnp.array([0, 1, 1])],
        lambda x: jax.jit(jnp.sin)(x),
        lambda x: jax.jit(jnp.cos)(x),
        lambda x: jax.lax.scan(lambda c, y: (c + y, c * y), 0.0, x)[1],
        lambda x: jax.lax.scan(lambda c, y: (c + y, c * y), 0.0, x, reverse=True)[1],
        lambda x: jnp.where(x > 0, x, 2 * x),
        lambda x: jnp.where(x > 0, 2 * x, x),
    ]
    names = [cache.fingerprint(jax.make_jaxpr(function)(X), [(1, 1)]) for function in functions]
    assert len(set(names)) == len(functions)
    again = [cache.fingerprint(jax.make_jaxpr(function)(X), [(1, 1)]) for function in functions]
    assert again == names


@pytest.mark.parametrize(
    "damage", [lambda b: b[: len(b) // 2], lambda b: b"", lambda b: b[:-40] + b"x" + b[-39:]]
)
def test_a_damaged_program_is_made_anew(folder: Path, damage: Callable[[bytes], bytes]) -> None:
    expected = value(jnp.sinh)
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    np.testing.assert_array_equal(value(jnp.sinh), expected)
    assert file.read_bytes() == whole


def test_where_nothing_can_be_written_nothing_is_kept(tmp_path: Path, folder: Path) -> None:
    folder.write_text("a file in the place of the folder")
    np.testing.assert_allclose(value(jnp.cosh), np.cosh(X), rtol=1e-15)
    assert folder.is_file()
