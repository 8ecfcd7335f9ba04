"""What a session has done, in words."""

from softfuse.hardware.live.session import SessionReport


def besides_samples(report: SessionReport) -> list[str]:
    """What else came from each source, CRC failures and the like; empty where nothing did."""
    return [
        ", ".join(f"{count} {what}" for what, count in counts.items() if count and what != "samples")
        for counts in report.line_counts
    ]


def latency(report: SessionReport) -> str:
    """From the last byte to the estimate."""
    quantiles = report.latency_p50_s, report.latency_p99_s, report.latency_max_s
    half, most, largest = (f"{1e3 * q:.1f}" for q in quantiles)
    return f"{half} ms (50 %), {most} ms (99 %), {largest} ms at most, from the last byte"


def told(report: SessionReport) -> list[str]:
    """All of it, line by line."""
    lines = [
        f"{report.frames} frames, {report.estimated} estimates, {report.overruns} overruns",
        f"latency {latency(report)}" if report.estimated else "nothing was estimated",
    ]
    for device in report.devices:
        lines.append(
            f"source {device.source}, device {device.device}: {device.samples.fresh} samples, "
            f"{device.samples.lost} lost, {device.samples.late} late, {device.samples.duplicated} twice"
        )
    lines += [f"source {k}: {found}" for k, found in enumerate(besides_samples(report)) if found]
    if report.missing:
        lines.append(f"channels that never came: {', '.join(report.missing)}")
    return lines
