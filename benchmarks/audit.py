"""Known weaknesses of the dependencies in requirements.lock, where their database can be reached.

    python -m benchmarks.audit

Ends with 1 if one is known, else with 0; what could not be asked for is said, not passed over.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

LOCK = Path(__file__).parents[1] / "requirements.lock"
LIMIT_S = 60.0


def main() -> int:
    """Ask pip-audit, and tell what it found or why it found nothing."""
    command = [sys.executable, "-m", "pip_audit", "-r", str(LOCK), "--no-deps", "--disable-pip"]
    try:
        done = subprocess.run(
            [*command, "--format", "json", "--progress-spinner", "off", "--timeout", "8"],
            capture_output=True,
            text=True,
            timeout=LIMIT_S,
            check=False,
        )
        found = json.loads(done.stdout)["dependencies"]
    except subprocess.TimeoutExpired:
        print(f"audit skipped: the database did not answer within {LIMIT_S:g} s")
        return 0
    except (ValueError, KeyError):
        reason = (done.stderr.strip().splitlines() or ["no answer"])[-1]
        print(f"audit skipped: {reason[:200]}")
        return 0
    asked = [one for one in found if "vulns" in one]
    weak = [one for one in asked if one["vulns"]]
    for one in weak:
        print(f"{one['name']} {one['version']}: " + ", ".join(v["id"] for v in one["vulns"]))
    unknown = len(found) - len(asked)
    if not asked:
        print(f"audit skipped: the database answered for none of {unknown} dependencies")
        return 0
    rest = f"; {unknown} could not be asked for" if unknown else ""
    print(f"audit: {len(weak)} of {len(asked)} dependencies have known weaknesses{rest}")
    return 1 if weak else 0


if __name__ == "__main__":
    sys.exit(main())
