"""The report of a run, as text for people and as JSON for programs."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from kilwa_dask.files import write_whole
from kilwa_dask.task import Outcome, Plan

STAGES = ("check", "build", "verify", "publish")


def size(number: float) -> str:
    """Format a number of bytes for people: 18.6 kB."""
    for unit in ("bytes", "kB", "MB", "GB"):
        if number < 1000:
            return f"{number:.0f} bytes" if unit == "bytes" else f"{number:.1f} {unit}"
        number /= 1000
    return f"{number:.1f} TB"


def duration(seconds: float) -> str:
    """Format a duration for people: 4.2 s, 3 min 20 s, 2 h 5 min."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    return f"{minutes // 60} h {minutes % 60} min"


def line(outcome: Outcome) -> str:
    """Describe the outcome of a mesh in one line, or in several if kilwa's message has several."""
    if outcome.state == "failed":
        return f"{outcome.name}: FAILED ({outcome.stage}): {outcome.message}"
    if outcome.state == "already done":
        return f"{outcome.name}: already done"
    times = ", ".join(f"{stage} {duration(outcome.seconds[stage])}" for stage in STAGES[1:] if stage in outcome.seconds)
    retried = f", earlier interrupted attempts: {outcome.retries}" if outcome.retries else ""
    return (
        f"{outcome.name}: {outcome.state}, {outcome.triangles:,} triangles, "
        f"{size(outcome.input_bytes)} to {size(outcome.pack_bytes)}, {times}{retried}"
    )


def summary(outcomes: Sequence[Outcome], seconds: float) -> str:
    """Describe a whole run: counts, totals of each stage, and every failure with its message."""
    states = Counter(outcome.state for outcome in outcomes)
    worked = [outcome for outcome in outcomes if outcome.state in ("built", "published")]
    lines = [
        f"{len(outcomes)} meshes in {duration(seconds)}: {states['built']} built, {states['published']} only published, "
        f"{states['already done']} already done, {states['failed']} failed; "
        f"earlier interrupted attempts: {sum(outcome.retries for outcome in outcomes)}"
    ]
    if worked:
        triangles = sum(outcome.triangles for outcome in worked)
        read, written = (sum(getattr(outcome, which) for outcome in worked) for which in ("input_bytes", "pack_bytes"))
        lines.append(f"{triangles:,} triangles, {size(read)} read, {size(written)} of packs written")
    lines += [f"{'stage':<10}{'meshes':>8}{'total':>14}{'mean':>10}{'longest':>10}{'failed':>8}"]
    for stage in (*STAGES, "place"):
        times = [outcome.seconds[stage] for outcome in outcomes if stage in outcome.seconds]
        failed = sum(outcome.state == "failed" and outcome.stage == stage for outcome in outcomes)
        if times or failed:
            total, longest = sum(times), max(times, default=0.0)
            mean = total / max(1, len(times))
            lines.append(f"{stage:<10}{len(times):>8}{duration(total):>14}{duration(mean):>10}{duration(longest):>10}{failed:>8}")
    lines += [line(outcome) for outcome in outcomes if outcome.state == "failed"]
    return "\n".join(lines)


def write(path: Path, plan: Plan, outcomes: Sequence[Outcome], seconds: float, *, stopped: bool) -> None:
    """Write the report as JSON, atomically."""
    states = Counter(outcome.state for outcome in outcomes)
    report = {
        "format": 1,
        "kilwa": plan.version,
        "output": plan.output,
        "publish": plan.publish,
        "options": list(plan.options),
        "seconds": round(seconds, 3),
        "stopped": stopped,
        "built": states["built"],
        "published_only": states["published"],
        "already_done": states["already done"],
        "failed": states["failed"],
        "retries": sum(outcome.retries for outcome in outcomes),
        "meshes": [asdict(outcome) for outcome in sorted(outcomes, key=lambda outcome: outcome.name)],
    }
    write_whole(path, json.dumps(report, indent=2) + "\n")
