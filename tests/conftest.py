"""What holds for all tests."""

import signal

# A shell that starts a command in the background (`nohup make test &`, as CI systems do) has it ignore SIGINT, which
# its children inherit; tests of Ctrl-C need Python's own handler.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
