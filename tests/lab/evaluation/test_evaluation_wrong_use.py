"""Wrong options of the evaluations: one line that names the option, what is expected and what was given."""

import pytest
from refused import refuse


@pytest.mark.parametrize(
    ("command", "named"),
    [
        ("integrity --fault gremlins", ["gremlins"]),
        ("integrity --runs -1", ["runs", "-1"]),
        ("integrity --nominal 0", ["nominal", "0"]),
        ("integrity --films films", ["--rendered"]),
        ("integrity --rendered --fault swapped_lines", ["'swapped_lines'"]),
        ("integrity --frames 1", ["frames", "1"]),
        ("integrity --visibility fog", ["fog"]),
        ("integrity --jobs -1 --runs 1 --nominal 1", ["jobs", "-1"]),
        ("localization --approaches 0", ["approaches", "0"]),
        ("localization --jobs -1", ["jobs", "-1"]),
        ("localization --detector nobody", ["nobody"]),
        ("localization --visibility thick --detector classical --rival classical", ["thick"]),
        ("localization --points --noise no-such.toml", ["no-such.toml"]),
        ("dehazing", ["--votes"]),
        ("dehazing nowhere --detector none", ["nowhere"]),
        ("dehazing nowhere --dehazer magic", ["magic"]),
        ("dehazing nowhere --dehazer nowhere.onnx", ["nowhere.onnx"]),
        ("dehazing nowhere --reference magic", ["magic"]),
        ("dehazing nowhere --detector magic", ["magic"]),
        ("dehazing nowhere --every 0", ["every", "0"]),
        ("dehazing nowhere --cost-size 0 8", ["cost_size", "0"]),
        ("dehazing nowhere --votes nowhere", ["--votes"]),
        ("flicker nowhere --every 0", ["--every", "1", "0"]),
        ("flicker nowhere --limit 1", ["--limit", "2", "1"]),
        ("flicker nowhere --camera-depth-m -5", ["--camera-depth-m", "0", "-5"]),
        ("flicker nowhere --dehazer fog-lamp", ["'fog-lamp'", "dark-channel"]),
        ("flicker nowhere --dehazer clear/dehaze.onnx", ["clear/dehaze.onnx", "called clear"]),
        ("flicker nowhere --dehazer a/b.onnx c/b.onnx", ["a/b.onnx", "c/b.onnx", "called b"]),
        ("detection nowhere --worst 3", ["--worst", "3"]),
        ("detection nowhere --deckless -1", ["deckless", "-1"]),
        ("detection nowhere --prior-sigma-m -1", ["--prior-sigma-m", "-1"]),
        ("detection --frames 1 --preset titanic", ["titanic"]),
        ("joined --approaches 0", ["--approaches", "0"]),
        ("joined --frames 1", ["--frames", "1"]),
    ],
)
def test_wrong_options_are_named_in_one_line(capsys, command, named):
    line = refuse(capsys, *command.split())
    assert all(name in line for name in named)
