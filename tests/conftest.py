"""What holds for all tests."""

import signal

from hypothesis import HealthCheck, settings

# A busy machine makes an example slow, which is no fault of the code.
settings.register_profile("any load", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any load")

# A shell that starts a command in the background (`nohup make test &`, as CI systems do) has it ignore SIGINT, which
# its children inherit; tests of Ctrl-C need Python's own handler.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
