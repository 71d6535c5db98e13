"""`drpbench view` as a user meets it."""

import re
import signal
import subprocess
import sys
import time

import pytest

pytestmark = pytest.mark.slow

COMPILES = 400  # [s] generous: compiling takes most of it
COMMAND = [sys.executable, "-m", "drpbench", "view"]


def view(*arguments, code=None):
    command = [*COMMAND, *arguments] if code is None else [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, timeout=COMPILES)


@pytest.mark.parametrize(
    ("arguments", "named", "right"),
    [
        (["--task", "XYZ"], "XYZ", "FDO"),
        (["--task", "FDO", "--policy", "nothing"], "nothing", "rmp"),
        (["--task", "FDO", "--id", "200"], "--id 200", "0 to 199"),
        (["--port", "0"], "--port 0", "1 to 65535"),
        (["--time-limit", "0"], "--time-limit 0", "above 0"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(arguments, named, right):
    pytest.importorskip("viser", reason="viser is not installed (extra `viewer`)")
    refused = view(*arguments)
    assert refused.returncode == 2, refused.stderr
    assert refused.stderr.count("\n") == 1 and "Traceback" not in refused.stderr
    assert named in refused.stderr and right in refused.stderr


def test_without_viser_the_extra_is_named():
    code = (
        "import sys; sys.modules['viser'] = None; sys.argv[1:] = ['view'];"
        "from drpbench.cli import main; main()"
    )
    refused = view(code=code)
    assert refused.returncode == 2
    assert refused.stderr.count("\n") == 1 and "pip install 'drpbench[viewer]'" in refused.stderr


def test_it_tells_its_address_and_ends_quietly():
    pytest.importorskip("viser", reason="viser is not installed (extra `viewer`)")
    process = subprocess.Popen(
        [*COMMAND, "--task", "SE", "--policy", "hold", "--id", "5"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A suite in the background of a shell ignores interrupts, and so would what it starts.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    told = ""
    end = time.monotonic() + COMPILES
    while not re.search(r"http://127\.0\.0\.1:\d+", told):
        assert time.monotonic() < end and process.poll() is None, told
        told += process.stdout.readline()
    process.send_signal(signal.SIGINT)
    rest, complaints = process.communicate(timeout=240)
    assert process.returncode == 0 and complaints == ""
    assert "Traceback" not in told + rest and "viser" not in told + rest
