"""Installs the node and its launch file for ament."""

from setuptools import setup

setup(
    name="ospc_live",
    version="0.1.0",
    packages=["ospc_live"],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/ospc_live"]),
        ("share/ospc_live", ["package.xml"]),
        ("share/ospc_live/launch", ["launch/live.launch.py"]),
    ],
    install_requires=["setuptools", "ospc"],
    entry_points={"console_scripts": ["live = ospc_live.node:main"]},
)
