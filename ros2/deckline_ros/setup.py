from setuptools import setup

NAME = "deckline_ros"

setup(
    name=NAME,
    version="0.2.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/deckline.launch.py"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="The deckline authors",
    maintainer_email="authors@example.org",
    description="deckline as a lifecycle node: pictures and poses in, guidance to a ship's landing deck out.",
    license="Apache-2.0",
    entry_points={"console_scripts": ["deckline_node = deckline_ros.node:main"]},
)
