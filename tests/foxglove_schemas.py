"""What Foxglove's schemas require of a message, and a check of values against a JSON schema.

The members are those of ``schemas/jsonschema/*.json`` in https://github.com/foxglove/foxglove-sdk,
under "required"; Grid.json requires none, and its table is that of all of its own fields in
https://docs.foxglove.dev/docs/sdk/schemas/grid.
"""

REQUIRED = {
    "foxglove.PoseInFrame": {"timestamp", "frame_id", "pose"},
    "foxglove.FrameTransform": {
        "timestamp", "parent_frame_id", "child_frame_id", "translation", "rotation",
    },
    "foxglove.Grid": {
        "timestamp", "frame_id", "pose", "column_count", "cell_size", "row_stride", "cell_stride",
        "fields", "data",
    },
    "foxglove.SceneUpdate": {"deletions", "entities"},
    "foxglove.GeoJSON": {"geojson"},
}  # fmt: skip
REQUIRED_IN = {
    "Pose": {"position", "orientation"},
    "Vector2": {"x", "y"},
    "Vector3": {"x", "y", "z"},
    "Quaternion": {"x", "y", "z", "w"},
    "Color": {"r", "g", "b", "a"},
    "PackedElementField": {"name", "offset", "type"},
    "KeyValuePair": {"key", "value"},
    "SceneEntity": {
        "timestamp", "frame_id", "id", "lifetime", "frame_locked", "metadata", "arrows", "cubes",
        "spheres", "cylinders", "lines", "triangles", "texts", "models",
    },
    "SceneEntityDeletion": {"timestamp", "type", "id"},
    "SpherePrimitive": {"pose", "size", "color"},
    "TextPrimitive": {"pose", "billboard", "font_size", "scale_invariant", "color", "text"},
}  # fmt: skip
TYPES = {
    "object": dict,
    "array": list,
    "string": str,
    "boolean": bool,
    "integer": int,
    "number": (int, float),
}


def faults(value, schema, where="message"):
    """Yield what of a value breaks its JSON schema; a member that it does not declare does, too."""
    kind = schema["type"]
    is_flag = isinstance(value, bool)
    if not isinstance(value, TYPES[kind]) or (is_flag and kind != "boolean"):
        yield f"{where}: {value!r} is no {kind}"
        return
    is_number = kind in ("integer", "number")
    if is_number and not schema.get("minimum", value) <= value <= schema.get("maximum", value):
        yield f"{where}: {value} is out of bounds"
    if kind == "array":
        for number, item in enumerate(value):
            yield from faults(item, schema["items"], f"{where}[{number}]")
    if kind == "object":
        properties = schema["properties"]
        for name in set(schema.get("required", ())) - set(value):
            yield f"{where}: {name} is missing"
        for name, item in value.items():
            if name not in properties:
                yield f"{where}: {name} is not declared"
            else:
                yield from faults(item, properties[name], f"{where}.{name}")


def titled(schema):
    """Yield the schemas with a name of Foxglove in a schema."""
    if str(schema.get("title", "")).startswith("foxglove."):
        yield schema
    for inner in schema.get("properties", {}).values():
        yield from titled(inner)
    if "items" in schema:
        yield from titled(schema["items"])
