"""What a release is made from: versions agree, licences are carried, configuration is what its tools read."""

import os
import re
import shutil
import subprocess
import sys
import zipfile
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest
import yaml

import ccpin
from tests.support.places import ROOT

WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
PROJECT = (ROOT / "pyproject.toml").read_text(encoding="utf-8")


def linted(module, *arguments):
    """What a linter says of files, nothing where they are sound; skipped where it is not installed."""
    tool = shutil.which(module, path=Path(sys.executable).parent)
    if tool is None:
        pytest.skip(f"{module} is not installed: it comes with the extra dev")
    run = subprocess.run([tool, *map(str, arguments)], cwd=ROOT, capture_output=True, text=True, timeout=120)
    return "" if run.returncode == 0 else run.stdout + run.stderr


def test_one_version_everywhere():
    """Package, metadata, citation, conda recipe and container name one, and CHANGELOG tells of it."""
    version = re.search(r'^version = "(.*)"$', PROJECT, re.MULTILINE)[1]
    assert ccpin.__version__ == version
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))["version"] == version
    recipe = yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text(encoding="utf-8"))
    assert recipe["context"]["version"] == version
    assert f"ccpin=={version}" in (ROOT / "Containerfile").read_text(encoding="utf-8")
    assert re.search(rf"^## {re.escape(version)}\b", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)


def test_the_conda_recipe_asks_for_what_the_wheel_asks():
    """Each dependency has the same bounds, under conda-forge's name."""
    renamed = {"pin": "pinocchio", "u-msgpack-python": "u-msgpack-python", "meshcat": "meshcat-python"}
    renamed |= {"matplotlib": "matplotlib-base", "PyYAML": "pyyaml"}
    inner = re.search(r"^dependencies = \[(.*?)^\]", PROJECT, re.MULTILINE | re.DOTALL)[1]
    wheel = dict(re.fullmatch(r"([\w.-]+)(.*)", each).groups() for each in re.findall(r'"(.*?)"', inner))
    recipe = yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text(encoding="utf-8"))["requirements"]["run"]
    asked = dict(each.split(" ", 1) for each in recipe)
    assert asked.pop("python") == re.search(r'requires-python = "(.*)"', PROJECT)[1]
    wheel.pop("numpy")  # conda-forge adds it itself, by what the core was built against
    assert asked == {renamed.get(name, name): bounds for name, bounds in wheel.items()}


def test_pyproject_is_valid():
    """By the standards' and the tools' own schemas, cibuildwheel's and scikit-build-core's among them."""
    assert linted("validate-pyproject", "pyproject.toml") == ""


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_are_valid(path):
    """By the schema of GitHub's workflows."""
    assert linted("check-jsonschema", "--builtin-schema", "vendor.github-workflows", path) == ""


def test_the_citation_is_valid():
    """By the schema of the Citation File Format."""
    assert linted("check-jsonschema", "--builtin-schema", "vendor.citation-file-format", "CITATION.cff") == ""


def test_workflows_give_nothing_away():
    """No secret is kept, no permission is wider than its job needs, no input of strangers is run."""
    assert linted("zizmor", "--offline", "--quiet", ".github/workflows") == ""


def test_licences_are_carried():
    """Each text that THIRD_PARTY.md names is there, each text there is named, and wheels get them all."""
    listed = (ROOT / "THIRD_PARTY.md").read_text(encoding="utf-8")
    texts = {f"licenses/{path.name}" for path in (ROOT / "licenses").iterdir()}
    assert set(re.findall(r"\]\((licenses/.*?)\)", listed)) == texts
    assert 'license-files = ["LICENSE", "THIRD_PARTY.md", "licenses/*.txt"]' in PROJECT


def test_nothing_by_others_lies_among_the_sources():
    """THIRD_PARTY.md says so: no minified script, font or library, and no notice of others' rights."""
    files = [path for path in (ROOT / "src").rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    kept = {path.suffix for path in files}
    package = {".cpp", ".hpp", ".xml", ".txt"}  # of ROS 2, in transmission/ros2: our own, declarations included
    assert (
        kept <= {".py", ".pyi", ".typed", ".md", ".js", ".css", ".html", ".so", ".svg", ".json", ".yaml", ""} | package
    )
    scripts = [path for path in files if path.suffix in (".js", ".css", ".html")]
    assert scripts
    for path in scripts:
        text = path.read_text(encoding="utf-8")
        assert max(map(len, text.splitlines())) < 400, path
        assert not re.search(r"copyright|@license", text, re.IGNORECASE), path


@pytest.fixture
def fitting():
    specification = spec_from_file_location("fitting", ROOT / "native" / "fitting.py")
    module = module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def wheel(path, digest):
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("ccpin/native/_core.abi3.so", b"a core")
        file.writestr("ccpin/native/_core.pyi", b"")
        if digest is not None:
            file.writestr("ccpin/native/_core.sha256", digest)
    return path


def test_a_wheel_fits_sources_it_was_built_from(fitting, tmp_path):
    """Its core is taken where the digests agree; a changed source, another digest or none is refused."""
    sources, place = tmp_path / "native", tmp_path / "place"
    shutil.copytree(ROOT / "native", sources)
    place.mkdir()
    own = fitting.digest(sources)
    assert not fitting.take(wheel(tmp_path / "other.whl", "0" * 64), sources, place)
    assert not fitting.take(wheel(tmp_path / "silent.whl", None), sources, place)
    assert list(place.iterdir()) == []
    assert fitting.take(wheel(tmp_path / "own.whl", own), sources, place)
    assert [path.name for path in place.iterdir()] == ["_core.abi3.so"]
    (sources / "bind.cpp").write_text("", encoding="utf-8")
    assert not fitting.take(tmp_path / "own.whl", sources, place)


def test_the_core_in_use_tells_its_sources(fitting):
    """Where the core was built from this checkout, the digest that lies beside it is that of `native/`."""
    core = pytest.importorskip("ccpin.native._core")
    told = Path(core.__file__).parent / "_core.sha256"
    if not told.exists():
        pytest.skip("this core lies beside the sources, taken from a wheel or built by hand")
    assert told.read_text(encoding="utf-8").strip() == fitting.digest(ROOT / "native")


def set_up(folder, digest):
    """Run scripts/setup.sh in a copy of the checkout that has a wheel in dist/; what a compiler was asked."""
    folder.mkdir()
    files, folders = ("pyproject.toml", "README.md", "LICENSE", "THIRD_PARTY.md"), ("licenses", "native", "scripts")
    for name in (*files, *folders, "src", "models"):
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, folder / name)
    core = Path(pytest.importorskip("ccpin.native._core").__file__)
    for stray in folder.glob("src/ccpin/native/_core*.so"):
        stray.unlink()
    subprocess.run([sys.executable, "-m", "venv", folder / ".venv"], check=True)
    inherited = Path(next(folder.glob(".venv/lib/python*/site-packages"))) / "inherited.pth"
    own = [path for path in sys.path if Path(path).is_relative_to(sys.prefix)]  # the dependencies, installed already
    inherited.write_text("\n".join(own), encoding="utf-8")
    (folder / "dist").mkdir()
    version = ccpin.__version__
    about = {"METADATA": f"Metadata-Version: 2.1\nName: ccpin\nVersion: {version}\n", "RECORD": ""}
    about["WHEEL"] = "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
    with zipfile.ZipFile(folder / "dist" / f"ccpin-{version}-py3-none-any.whl", "w") as file:
        file.write(core, f"ccpin/native/{core.name}")
        file.writestr("ccpin/native/_core.sha256", digest)
        for name, text in about.items():
            file.writestr(f"ccpin-{version}.dist-info/{name}", text)
    compiler, script = folder / "compiler", folder / "scripts" / "told.sh"
    compiler.write_text(f'#!/bin/sh\necho "$@" >> "{folder}/asked"\nexit 1\n', encoding="utf-8")
    compiler.chmod(0o755)
    told = """exec .venv/bin/python -c 'import ccpin; print(ccpin.backend().reason)'"""
    script.write_text(f'. "$(dirname "$0")/setup.sh"\n{told}\n', encoding="utf-8")
    environment = {**os.environ, "PYTHON": sys.executable, "CXX": str(compiler)}
    run = subprocess.run(["sh", script], env=environment, capture_output=True, text=True, timeout=600)
    assert run.returncode == 0, run.stderr
    asked = folder / "asked"
    return run.stdout, asked.read_text(encoding="utf-8") if asked.exists() else ""


@pytest.mark.slow
def test_a_fitting_wheel_spares_the_compiler(fitting, tmp_path):
    """With a wheel of the same native/ in dist/ no compiler is called; with one of another it builds (here: cannot)."""
    told, asked = set_up(tmp_path / "fits", fitting.digest(ROOT / "native"))
    assert asked == ""
    assert str(tmp_path / "fits" / "src") in told
    told, asked = set_up(tmp_path / "other", "0" * 64)
    assert asked != ""
    assert "not built" in told
