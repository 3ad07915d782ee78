"""What all tests share: linear algebra in one thread, as in every command, before numpy starts."""

from __future__ import annotations

from beltid.cli.process import one_thread_each

one_thread_each()
