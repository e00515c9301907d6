"""The pytest plugin: an example project's tests pass, fail and are renewed; libraries, good and bad; its costs."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import listing, needs_device
from processes import ROOT
from scene_files import write

import clshade
from clshade.errors import InputError, OutputError
from clshade.images import compare_figure, png  # noqa: F401  (imported once: runs within this process forget what they import)
from clshade.images.image_file import read_picture
from clshade.pipeline.frame import Frame
from clshade.view import page  # noqa: F401
from clshade.view.regression import image_regression, plugin

pytest_plugins = ["pytester"]
PLUGIN = "clshade.view.regression.plugin"
README = (ROOT / "clshade" / "view" / "regression" / "README.md").read_text()
POT = re.search(r"^```python test_pot.py\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)[1]
DRAWN = 'layers=("Z", "id"), resolution=(161, 97)'
KEYS = ["TestLenses::test_zoom[30.0]/rolled", "TestLenses::test_zoom[30.0]/upright"]
KEYS += ["TestLenses::test_zoom[60.0]/rolled", "TestLenses::test_zoom[60.0]/upright", "test_pot"]
DIGEST = "float32 1x2x4 " + 64 * "0"


@pytest.fixture
def run(pytester, monkeypatch):
    """Return a function that runs pytest on the project in `pytester.path`, within this process, without other plugins."""
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    monkeypatch.delenv("PYTEST_ADDOPTS", raising=False)

    def run(*arguments, **outcomes):
        done = pytester.runpytest_inprocess("-p", PLUGIN, *arguments)
        done.assert_outcomes(**outcomes)
        return done.stdout.str()

    return run


@pytest.fixture
def project(opened, pytester):
    """Return a function that writes the project's tests: those of the README, with one text replaced."""

    def make(old="", new="", text=POT):
        assert old in text
        return pytester.makepyfile(test_pot=text.replace(old, new))

    make()
    return make


def contents(folder: Path) -> dict[str, bytes]:
    pictures = {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("test_pot_images*/*")}
    return {**pictures, "json": (folder / "test_pot_images.json").read_bytes()}


@pytest.mark.long
@needs_device
def test_a_project_is_kept_passes_fails_and_is_renewed(project, pytester, run):
    folder = pytester.path
    out = run(failed=3)
    assert "test_pot_images.json has no image test_pot\n" in out
    assert "if the result is right: pytest test_pot.py::test_pot --clshade-update" in out
    assert not (folder / "test_pot_images.json").exists()

    out = run("--clshade-update", passed=3)
    assert [line.partition(": ")[2] for line in out.splitlines() if line.startswith("created ")] == KEYS
    assert "\n5 created\n" in out
    kept = contents(folder)
    assert len(kept) == 6
    assert list(json.loads(kept["json"])["images"]) == KEYS
    example = json.loads(re.search(r"^```json\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)[1])
    assert example == {"clshade_images": 1, "images": {"test_pot": json.loads(kept["json"])["images"]["test_pot"]}}
    assert "clshade images" not in run(passed=3)
    assert "\n5 unchanged\n" in run("--clshade-update", passed=3)
    assert contents(folder) == kept

    project(DRAWN, f"{DRAWN}, background='#336699'")
    out = run("--clshade-out", "failures", passed=2, failed=1)
    assert contents(folder) == kept
    made = folder / "failures" / "test_pot" / "test_pot"
    names = [f"{name}.{kind}" for name in ("difference", "reference", "result") for kind in ("exr", "png")]
    assert listing(made) == [*names[:2], "index.html", *names[2:]]
    lines = out[out.index("clshade_image_regression: test_pot differs from test_pot_images.json") :].splitlines()
    colors = re.fullmatch(r"  RGB: (\d+) of 15617 pixels differ, most at column (\d+), row (\d+) .*", lines[1])
    assert lines[2].startswith("  settings, background: expected none, found (0.0331")
    assert lines[3].startswith("  result, reference, difference as EXR and PNG, ")
    assert lines[3].endswith(str(made))
    assert lines[4] == "  if the result is right: pytest test_pot.py::test_pot --clshade-update"
    difference, reference, result = (read_picture(made / f"{names[k]}") for k in (0, 2, 4))
    off = np.abs(result.color()[1] - reference.color()[1])
    np.testing.assert_array_equal(difference.color()[1], off)
    assert np.count_nonzero(off.max(axis=2)) == int(colors[1])
    assert off[int(colors[3]), int(colors[2])].max() == off.max()
    assert not difference.channels["Z"].any()
    assert (made / "reference.exr").read_bytes() == kept["test_pot_images/test_pot.exr"]
    assert "<title>result and reference of teapot</title>" in (made / "index.html").read_text()

    out = run("--clshade-update", passed=3)
    assert re.search(r"^updated test_pot_images.json: test_pot \(RGB: \d+ of 15617 pixels differ, ", out, re.M)
    assert "\n1 updated, 4 unchanged\n" in out
    changed = contents(folder)
    assert [name for name in kept if kept[name] != changed[name]] == ["test_pot_images/test_pot.exr", "json"]
    run(passed=3)


ONE = f"""
import clshade
def test_pot(clshade_image_regression):
    clshade_image_regression(clshade.builtin("teapot"), {DRAWN})
"""


def test_references_may_be_left_out(project, pytester, run):
    project(text=ONE)
    pytester.makeini("[pytest]\nclshade_reference_images = false\n")
    run("--clshade-update", passed=1)
    assert not (pytester.path / "test_pot_images").exists()
    run(passed=1)


@pytest.fixture
def fixture(opened, request, tmp_path):
    """Return the fixture's object for the test that asks for it, with a library in a temporary folder."""

    def make(**changes):
        config, listchain = request.node.config, request.node.listchain
        test = SimpleNamespace(path=tmp_path / "test.py", config=config, listchain=listchain, user_properties=[])
        default = {"update": False, "references": True, "out": tmp_path / "out", "temporary": tmp_path.joinpath}
        return image_regression.ImageRegression(test, **{**default, **changes})

    return make


@pytest.mark.parametrize(("arguments", "options", "message"), [
    ((3,), {}, "clshade_image_regression: scene: expected a Scene or a Frame, found 3"),
    (("teapot", ""), {}, "clshade_image_regression: name: expected 1 to 60 letters, digits, _, - and ., or None"),
    (("teapot", "a/b"), {}, "clshade_image_regression: name: expected 1 to 60 letters"),
    (("teapot",), {"smaples": 4}, "did you mean 'samples'?"),
    (("teapot",), {"nme": "x"}, "did you mean 'name'?"),
    (("teapot",), {"samples": 65}, "Settings: samples: expected"),
])  # fmt: skip
def test_refused_arguments(fixture, arguments, options, message):
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        fixture()(clshade.builtin("teapot") if arguments[0] == "teapot" else arguments[0], *arguments[1:], **options)
    assert "\n" not in str(caught.value)


def flat(value: float = 0.0) -> Frame:
    """Return a frame of 2 x 1 pixels that nothing was drawn for, in float64."""
    scene = clshade.builtin("quads", resolution=(2, 1))
    return Frame(np.full((1, 2, 4), value), {}, scene, clshade.Settings(precision="float64"), lambda: {"times_ms": {}})


def test_a_frame_has_no_options_and_each_image_a_name_of_its_own(fixture):
    frame = flat()
    compare = fixture(update=True)
    with pytest.raises(InputError, match="samples: expected no option for a Frame, which is drawn already, found 4"):
        compare(frame, "first", samples=4)
    assert compare(frame) is frame
    compare(frame, "second")
    for name in (None, "second"):
        with pytest.raises(InputError, match="name: expected another one for each image of a test"):
            compare(frame, name)


def problems(compare, frame: Frame) -> list[str]:
    with pytest.raises(pytest.fail.Exception) as caught:
        compare(frame)
    return [line.strip() for line in str(caught.value).splitlines()[1:-2]]


def test_other_layers_sizes_and_bits_fail(fixture):
    frame = flat()
    with_depth = Frame(frame.rgba, {"Z": np.ones((1, 2), np.float32)}, frame.scene, frame.settings, dict)
    fixture(update=True)(with_depth)
    other = Frame(frame.rgba[:, :1], {"id": np.zeros((1, 1), np.uint32)}, frame.scene, frame.settings, dict)
    assert problems(fixture(), other) == [
        "rgba: expected float64 1x2x4, found float64 1x1x4",
        "id: expected none, found uint32 1x1",
        "Z: expected float32 1x2, found none",
    ]
    with_depth["Z"].view("u4")[0, 1] ^= 1
    (line,) = problems(fixture(), with_depth)
    assert line.startswith("Z: 1 of 2 pixels differ, most at column 1, row 0 from the top: expected ")
    fixture(update=True)(flat(1.0))
    assert problems(fixture(), flat(1.0 + 1e-12)) == ["rgba: other bits, equal values in float32"]


def test_references_that_are_not_there_or_of_other_hashes(fixture, tmp_path):
    fixture(update=True)(flat())
    library, (path,) = tmp_path / "test_images.json", (tmp_path / "test_images").iterdir()
    kept = library.read_text()
    entries = json.loads(kept)
    next(iter(entries["images"].values()))["rgba"] = DIGEST.replace("float32", "float64")
    library.write_text(json.dumps(entries))
    with pytest.raises(pytest.fail.Exception) as caught:
        fixture()(flat())
    assert f"rgba: other bits; {path} is not the image of the library, and is not shown\n" in str(caught.value)
    assert "result as EXR and PNG, and index.html" in str(caught.value)
    library.write_text(kept)
    for damage, message in (
        (lambda: path.write_bytes(b"no EXR"), f"no reference image: {path}: file: expected an OpenEXR or PNG image"),
        (path.unlink, f"there is no reference image {path}"),
    ):
        damage()
        with pytest.raises(pytest.fail.Exception) as caught:
            fixture()(flat(1.0))
        assert message in str(caught.value)
    fixture(update=True)(flat())
    assert (library.read_text(), path.is_file()) == (kept, True)


def test_a_folder_that_cannot_be_written(fixture, tmp_path, monkeypatch):
    def fail(*arguments, **options):
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(os, "replace", fail)
    for references in (True, False):
        with pytest.raises(pytest.fail.Exception, match=r"cannot be written: Read-only file system") as caught:
            fixture(update=True, references=references)(flat())
        assert "\n" not in str(caught.value)
        assert listing(tmp_path) == []


def test_where_the_files_of_a_difference_cannot_be_written(fixture, tmp_path):
    (tmp_path / "out").write_text("a file")
    with pytest.raises(pytest.fail.Exception) as caught:
        fixture()(flat())
    _, second, last = str(caught.value).splitlines()
    assert "cannot be written" in second
    assert last.endswith(" --clshade-update")
    assert listing(tmp_path) == ["out"]


@pytest.mark.parametrize(("text", "message"), [
    ("", "file: expected content, found an empty file"),
    ("{", "JSON: expected a library of images, found Expecting property name"),
    ("{}", "clshade_images: expected version 1, found none"),
    ('{"clshade_images": true, "images": {}}', "clshade_images: expected version 1, found True"),
    ('{"clshade_images": 1, "image": {}}', "found 'image': did you mean 'images'?"),
    ('{"clshade_images": 1, "images": {"a": {}, "a": {}}}', "found 'the key a twice'"),
    ('{"clshade_images": 1, "images": {"a": 1}}', "images, 'a': expected an object, found 1"),
    ('{"clshade_images": 1, "images": {"a": {"Z": "%s"}}}', "images, 'a': expected rgba among its keys, found Z"),
    ('{"clshade_images": 1, "images": {"a": {"rgba": "%s0"}}}', "'a', rgba: expected type, shape and SHA-256"),
    ('{"clshade_images": 1, "images": {"a": {"objectid": "%s"}}}', "'objectid': did you mean 'object_id'?"),
])  # fmt: skip
def test_bad_libraries(fixture, tmp_path, text, message):
    path = tmp_path / "test_images.json"
    path.write_text(text.replace("%s", DIGEST))
    for update in (False, True):
        with pytest.raises(pytest.fail.Exception) as caught:
            fixture(update=update)(flat())
        assert str(caught.value).startswith(f"clshade_image_regression: {path}: ")
        assert message in str(caught.value)
        assert "\n" not in str(caught.value)
        assert path.read_text() == text.replace("%s", DIGEST)


def test_names_of_files_tell_images_apart():
    keys = ["test_a", "test_A", "test_b[a/b]", "test_b[a-b]", "test_b[ü]", "x" * 300, "x" * 299, "..", "."]
    names = [image_regression.file_name(key) for key in keys]
    assert names[0] == "test_a"
    assert len({name.lower() for name in names}) == len(keys)
    assert all(re.fullmatch(r"[A-Za-z0-9_.-]{1,100}", name) and name not in (".", "..") for name in names)


def test_hashes_are_those_of_the_bytes_on_any_machine():
    values = np.arange(6, dtype=np.float32).reshape(2, 3)
    digest = image_regression.digest
    assert digest(values) == digest(values.astype(">f4")) == digest(np.asfortranarray(values))
    assert digest(values) != digest(values.T.copy())
    assert digest(values) != digest(values.view(np.uint32))
    assert digest(np.zeros(1)) != digest(-np.zeros(1))


WRITER = """
import sys
from pathlib import Path
from clshade.view.regression import image_regression
for number in range(20):
    key, entry = f"{sys.argv[1]}{number:02}", {"rgba": sys.argv[2]}
    image_regression.put_image(Path("test_images.json"), key, entry, lambda file: file.write(b"x"))
"""


@pytest.mark.long
def test_processes_that_renew_one_library_at_once_lose_nothing(tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", WRITER]
    running = [subprocess.Popen([*command, name, DIGEST], cwd=tmp_path, env=environment) for name in "ab"]
    assert [process.wait(60) for process in running] == [0, 0]
    keys = [f"{name}{number:02}" for name in "ab" for number in range(20)]
    assert list(image_regression.read_library(tmp_path / "test_images.json")) == keys
    assert listing(tmp_path) == sorted(["test_images", "test_images.json", *(f"test_images/{key}.exr" for key in keys)])


def test_a_library_that_stays_locked_or_is_a_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(image_regression, "_PATIENCE", 0.0)
    monkeypatch.setattr(image_regression, "lock_file", lambda path: None)
    with pytest.raises(OutputError, match=r"a_images.json: cannot be written: another process has held .* for 0 s"):
        image_regression.put_image(tmp_path / "a_images.json", "key", {"rgba": DIGEST}, None)
    (tmp_path / "a_images.json").mkdir()
    with pytest.raises(InputError, match="expected a regular file, found a folder"):
        image_regression.read_library(tmp_path / "a_images.json")


@pytest.mark.long
def test_it_costs_nothing_before_a_test_asks_for_an_image(pytester, monkeypatch):
    """Installed as a distribution with this entry point alone: found, loaded, and nothing heavy with it."""
    entry = re.escape(f'[project.entry-points.pytest11]\nclshade = "{PLUGIN}"\n')
    assert re.search(f"^{entry}", (ROOT / "pyproject.toml").read_text(), re.M)
    installed = pytester.path / "installed" / "clshade_plugin-1.dist-info"
    write(installed / "METADATA", "Metadata-Version: 2.1\nName: clshade-plugin\nVersion: 1\n")
    write(installed / "entry_points.txt", f"[pytest11]\nclshade = {PLUGIN}\n")
    pytester.makepyfile(
        """
        import sys
        def test_heavy(request):
            assert request.config.pluginmanager.has_plugin("clshade")
            assert not {"numpy", "pyopencl", "matplotlib", "OpenEXR", "PIL"} & set(sys.modules)
        """
    )
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(installed.parent), str(ROOT)]))
    pytester.runpytest_subprocess("-pno:hypothesispytest", "-pno:anyio").assert_outcomes(passed=1)


@pytest.mark.sampled
@pytest.mark.parametrize("plugin", ["regressions", "others"])
def test_another_plugin_keeps_its_fixture_of_the_same_name(pytester, run, plugin):
    test = "def test(image_regression, clshade_image_regression):\n    assert {} == clshade_image_regression\n"
    pytester.makepyfile(test_short=test.format("image_regression"))
    run("test_short.py", passed=1)
    theirs = "import pytest\n@pytest.fixture\ndef image_regression():\n    return 'theirs'\n"
    pytester.makepyfile(**{plugin: theirs, "test_both": test.replace("{} ==", "image_regression == 'theirs' !=")})
    pytester.syspathinsert()
    run("-p", plugin, "test_both.py", passed=1)


def test_the_fixtures_are_listed_with_what_they_do(pytester, run):
    out, usage = (pytester.runpytest_inprocess("-p", PLUGIN, name).stdout.str() for name in ("--fixtures", "--help"))
    line = r"^clshade_image_regression -- .*\n    Draw a scene and compare image and layers, bit for bit"
    assert re.search(line, out, re.M)
    assert {plugin.UPDATE, plugin.OUT} <= set(re.findall(r"--clshade-\w+", usage))


@pytest.mark.long
@needs_device
def test_processes_of_xdist_renew_a_library(project, pytester, monkeypatch):
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    arguments = ("-p", PLUGIN, "-p", "xdist")
    done = pytester.runpytest_subprocess(*arguments, "-n", "2", "--dist", "load", "--clshade-update")
    done.assert_outcomes(passed=3)
    assert "\n5 created\n" in done.stdout.str()
    assert list(image_regression.read_library(pytester.path / "test_pot_images.json")) == KEYS
    pytester.runpytest_subprocess(*arguments).assert_outcomes(passed=3)
