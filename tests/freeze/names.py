"""Public names as a table: what the package offers, with parameters, members and values."""

import inspect
import re
from enum import Enum
from importlib import import_module
from types import ModuleType

from flgpr import types
from flgpr.lazy import Verb
from flgpr.model import Sensor, bounds
from flgpr.recipe.schema import Recipe, load_recipe, recipe_names
from flgpr.simulate import Scene
from freeze.frozen import DATA, read_json

TABLE = DATA / "names.json"
SETTINGS = DATA / "settings.json"
RECIPES = DATA / "recipes.json"
_LONGEST = 200
_MODULE = re.compile(r"\b(?:[A-Za-z_]\w*\.)+(?=[A-Za-z_])")
_ALIASES = dict(
    re.findall(
        r"^(\w+) = ((?:NDArray|Annotated|dict)\[.*\])$",
        inspect.getsource(types) + inspect.getsource(bounds),
        re.MULTILINE,
    )
)
"""Types of arrays and bounded numbers, which are frozen as what they are, whatever their names."""
_ALIAS = re.compile(rf"\b({'|'.join(_ALIASES)})\b")


def public_modules() -> dict[str, list[str]]:
    """Return the modules that users import, which the table itself lists, and the names of each.

    Sources are not looked through: a module may lie anywhere as long as its name is imported. A new
    one is put into the table by hand, with ``{}`` or, if it has no ``__all__``, with its names.
    """
    listed = read_json(TABLE)
    return {module: offered(module) or sorted(names) for module, names in listed.items()}


def offered(module: str) -> list[str]:
    """Return what a module says that it offers; nothing where it says nothing."""
    return sorted(getattr(import_module(module), "__all__", ()))


def name_table() -> dict[str, dict]:
    """Describe every public name by its module."""
    described = {}
    for module, names in public_modules().items():
        home = import_module(module)
        described[module] = {name: describe(getattr(home, name)) for name in names}
    return described


def describe(value):
    """Describe what is called by its signature, a class by its members as well, or a value."""
    if isinstance(value, Verb):
        return "package" + signature(value)
    if isinstance(value, ModuleType):
        return "package"
    if inspect.isclass(value):
        return _describe_class(value)
    if inspect.isroutine(value):
        return signature(value)
    text = _default(value)
    kind = type(value).__name__
    return f"{kind} {text}" if len(text) <= _LONGEST else kind


def signature(function) -> str:
    """Write parameters with types and defaults, and the type of what is returned."""
    known = inspect.signature(function)
    kinds = inspect.Parameter
    words = []
    before = None
    for one in known.parameters.values():
        if before == kinds.POSITIONAL_ONLY and one.kind != before:
            words.append("/")
        named = one.kind == kinds.KEYWORD_ONLY
        if named and before not in (kinds.KEYWORD_ONLY, kinds.VAR_POSITIONAL):
            words.append("*")
        before = one.kind
        word = {kinds.VAR_POSITIONAL: "*", kinds.VAR_KEYWORD: "**"}.get(one.kind, "") + one.name
        if one.annotation is not kinds.empty:
            word += f": {annotation(one.annotation)}"
        if one.default is not kinds.empty:
            word += f" = {_default(one.default)}"
        words.append(word)
    returned = ""
    if known.return_annotation is not inspect.Signature.empty:
        returned = f" -> {annotation(known.return_annotation)}"
    return f"({', '.join(words)}){returned}"


def annotation(kind) -> str:
    """Write a type without the modules of its classes, which may lie elsewhere tomorrow."""
    text = kind.__name__ if isinstance(kind, type) else str(kind)
    while _ALIAS.search(text):
        text = _ALIAS.sub(lambda alias: _ALIASES[alias[0]], text)
    return _MODULE.sub("", text)


def _default(value) -> str:
    if inspect.isroutine(value) or inspect.isclass(value):
        return value.__qualname__
    if isinstance(value, set | frozenset):
        return repr(sorted(value))
    return re.sub(" at 0x[0-9a-f]+", "", repr(value))


def _describe_class(kind: type) -> dict:
    own = [one for one in reversed(kind.__mro__) if one.__module__.startswith("flgpr")]
    described = {"is a": ", ".join(["class", *_built_in(kind)])}
    if issubclass(kind, Enum):
        described["values"] = ", ".join(f"{one.name} = {one.value!r}" for one in kind)
    elif hasattr(kind, "model_fields"):
        described["call"] = _fields(kind)
    elif not issubclass(kind, Exception):
        described["call"] = signature(kind)
    for one in own:
        for name, value in vars(one).items():
            if not name.startswith("_") and name not in ("model_fields", "model_config"):
                described[f".{name}"] = _member(value)
    return described


def _fields(kind: type) -> str:
    """Write the fields of a pydantic class as the parameters that they are."""
    words = []
    for name, field in kind.model_fields.items():
        declared = next(one for one in kind.__mro__ if name in vars(one).get("__annotations__", {}))
        word = f"{name}: {annotation(declared.__annotations__[name])}"
        words.append(word if field.is_required() else f"{word} = {_default(field.default)}")
    return f"({', '.join(words)})"


def _built_in(kind: type) -> list[str]:
    """Name the types of Python that a class is one of, by which users catch or unpack it."""
    bases = [one for one in kind.__mro__ if one.__module__ == "builtins"]
    return [one.__name__ for one in bases if one is not object]


def _member(value) -> str:
    if isinstance(value, classmethod | staticmethod):
        value = value.__func__
    if inspect.isfunction(value):
        return signature(value)
    if isinstance(value, property) or type(value).__name__ == "cached_property":
        return "property"
    return "value"


def settings() -> dict[str, dict]:
    """Return what recipes, scenes and sensors may hold: names, types, limits and defaults."""
    return {
        one.__name__: _without_words(one.model_json_schema()) for one in (Recipe, Scene, Sensor)
    }


def _without_words(schema):
    """Take titles and descriptions out of a JSON schema; entries of those names are kept."""
    if isinstance(schema, list):
        return [_without_words(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    kept = {}
    for name, value in schema.items():
        if name in ("title", "description") and isinstance(value, str):
            continue
        if name == "properties":
            kept[name] = {entry: _without_words(one) for entry, one in value.items()}
        else:
            kept[name] = _without_words(value)
    return kept


def packaged_recipes() -> dict[str, dict]:
    """Return every packaged recipe as it is read, without its description."""
    return {
        name: load_recipe(name).model_dump(mode="json", exclude={"description"})
        for name in recipe_names()
    }
