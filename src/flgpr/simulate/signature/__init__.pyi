from flgpr.simulate.signature.body import Body, BodyLayer, load_body, packaged_bodies
from flgpr.simulate.signature.build import build_table
from flgpr.simulate.signature.table import (
    FREQUENCY,
    PERMITTIVITY,
    SEPARATION,
    SINE,
    SignatureTable,
    find_table,
    load_table,
    packaged_table,
    save_table,
)

__all__ = [
    "FREQUENCY",
    "PERMITTIVITY",
    "SEPARATION",
    "SINE",
    "Body",
    "BodyLayer",
    "SignatureTable",
    "build_table",
    "find_table",
    "load_body",
    "load_table",
    "packaged_bodies",
    "packaged_table",
    "save_table",
]
