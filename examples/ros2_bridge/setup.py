"""Packaging of the bridge for colcon."""

from setuptools import setup

PACKAGE = "flgpr_bridge"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=[PACKAGE],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="The maintainer of your vehicle",
    maintainer_email="maintainer@example.org",
    description="Forwards scans and poses of a vehicle to flgpr live over TCP.",
    license="BSD-3-Clause",
    entry_points={"console_scripts": [f"bridge = {PACKAGE}.bridge:main"]},
)
