"""What holds for all tests."""

import signal

import pytest
from hypothesis import HealthCheck, settings

# A busy machine makes an example slow, which is no fault of the code.
settings.register_profile("any load", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any load")

# A shell that starts a command in the background (`nohup make test &`, as CI systems do) has it ignore SIGINT, which
# its children inherit; tests of Ctrl-C need Python's own handler.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def opengl():
    """Skips on a machine without OpenGL."""
    from deckline_sim.scene.gl import RendererError, open_context  # moderngl is slow to import

    try:
        open_context().release()
    except RendererError as error:
        pytest.skip(f"no OpenGL on this machine: {error}")
