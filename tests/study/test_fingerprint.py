"""The hash of a study's sources changes with what the study imports and reads."""

from fecloth.study.fingerprint import source_of


def test_source_is_that_of_imports_and_scenes_too(tmp_path):
    study, beside = tmp_path / "study.py", tmp_path / "beside.py"
    study.write_text("def f():\n    from beside import g\n")
    hashes = []
    for text in ("g = 1", "g = 2"):
        beside.write_text(text)
        source_of.cache_clear()
        hashes.append(source_of(study))
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "swing.toml").write_text("dt = 0.1")
    source_of.cache_clear()
    assert len({*hashes, source_of(study)}) == 3
