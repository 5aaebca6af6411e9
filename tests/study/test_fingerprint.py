"""The hash of a study's sources changes with what the study imports and reads."""

import fecloth
from fecloth.study.fingerprint import source_hash


def test_the_hash_covers_imports_and_scenes(tmp_path):
    study, beside = tmp_path / "study.py", tmp_path / "beside.py"
    study.write_text("def f():\n    from beside import g\n")
    hashes = []
    for text in ("g = 1", "g = 2"):
        beside.write_text(text)
        source_hash.cache_clear()
        hashes.append(source_hash(study))
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "swing.toml").write_text("dt = 0.1")
    source_hash.cache_clear()
    assert len({*hashes, source_hash(study)}) == 3


def test_the_hash_covers_the_data_of_the_package(tmp_path, monkeypatch):
    study, data = tmp_path / "study.py", tmp_path / "units.toml"
    study.write_text("")
    monkeypatch.setattr(fecloth, "__file__", str(tmp_path / "__init__.py"))
    hashes = []
    for text in ("m = 1.0", "m = 2.0"):
        data.write_text(text)
        source_hash.cache_clear()
        hashes.append(source_hash(study))
    assert hashes[0] != hashes[1]
