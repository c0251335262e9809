"""The folder of the compiled kernels."""

from orchard.sim.kernels import cache


def test_kernels_are_there_once_numba_has_kept_some_of_these_sources(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert not cache.are_compiled()
    (tmp_path / "kernels-of-other-sources").mkdir()
    (tmp_path / "kernels-of-other-sources" / "scan.nbc").touch()
    assert not cache.are_compiled()
    folder = cache.kernels_folder() / "orchard_0123"
    folder.mkdir(parents=True)
    (folder / "laser_kernel.cast_all-1.py311.1.nbc").touch()
    assert cache.are_compiled()
