"""Packages by their stubs: names load when they are asked for, and a package can be called."""

import inspect
import sys
from types import ModuleType

import pytest

import flgpr
from flgpr.lazy import Verb, face


@pytest.fixture
def package(tmp_path, monkeypatch):
    stub = tmp_path / "__init__.pyi"
    stub.write_text(
        "from typing import Any\nfrom math import pi as pi\nfrom math import hypot as length\n"
    )
    module = ModuleType("some_package")
    monkeypatch.setitem(sys.modules, "some_package", module)
    return module, face("some_package", str(tmp_path / "__init__.py"))


def test_the_names_are_those_of_the_stub(package):
    _, (_, list_names, names) = package
    assert names == list_names() == ["length", "pi"]


def test_a_name_is_loaded_once_and_kept(package):
    module, (load, _, _) = package
    assert not hasattr(module, "length")
    assert load("length")(3, 4) == 5
    assert module.length(3, 4) == 5
    with pytest.raises(AttributeError, match="'some_package' has no attribute 'Any'"):
        load("Any")


def test_a_name_whose_home_is_not_installed_is_left_out(tmp_path, monkeypatch):
    stub = "from math import pi as pi\nfrom no_such_home.room import thing as thing\n"
    (tmp_path / "__init__.pyi").write_text(stub)
    monkeypatch.setitem(sys.modules, "some_package", ModuleType("some_package"))
    load, list_names, names = face("some_package", str(tmp_path / "__init__.py"))
    assert names == list_names() == ["pi"]
    with pytest.raises(AttributeError, match="'some_package' has no attribute 'thing'"):
        load("thing")


def test_a_callable_package_shows_its_function():
    assert isinstance(flgpr.simulate, Verb)
    assert inspect.signature(flgpr.simulate) == inspect.signature(flgpr.simulate.simulate)
    assert "flgpr.simulate(" in flgpr.simulate.__doc__


def test_a_callable_package_is_the_package_to_all_who_ask_it(monkeypatch):
    from flgpr.simulate import effort

    package = sys.modules["flgpr.simulate"]
    assert flgpr.simulate.effort is package.effort is effort
    assert "Scene" in dir(flgpr.simulate)
    monkeypatch.setattr("flgpr.simulate.something", 1, raising=False)
    assert package.something == flgpr.simulate.something == 1
    monkeypatch.delattr("flgpr.simulate.something")
    assert not hasattr(package, "something")
