"""The page of a campaign: all rows, and a picture of R and X of every case."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

from torchliner.campaign.index import DONE, impedance, index_table, interval, read_index
from torchliner.io.whole_file import writable
from torchliner.records.level_check import FAILS
from torchliner.report.answer import Answer, Picture
from torchliner.report.page import ENDING, shown, write_page
from torchliner.report.studies import draw_cases

MOST_DRAWN = 60  # cases


def report_campaign(folder: Path, output: Path) -> Answer:
    """The page of a folder that ``torchliner run`` keeps; returns what is on it.

    Raises:
        ImportError: jinja2 or matplotlib is not installed.
        OSError, ValueError: no campaign; an output that cannot be written.
    """
    rows = sorted(read_index(folder), key=lambda row: (row["unit"], row["frequency"]))
    if not rows:
        raise ValueError(f"{folder} holds no index.csv; it is the folder of no campaign (torchliner run writes one)")
    writable(output, ENDING)
    done = [row for row in rows if row["status"] == DONE]
    failed = {row["unit"]: row["error"] for row in rows if row["status"] != DONE}
    fails = [row for row in done if str(row["level_check"]).endswith(FAILS)]
    units = {row["unit"] for row in rows}
    ranges = [
        f"{part} from {min(known):.3f} to {max(known):.3f}"
        for part in ("resistance", "reactance")
        if (known := [row[part] for row in done if math.isfinite(row[part])])
    ]
    notes = [f"{unit}: failed: {shown(error)}" for unit, error in failed.items()]
    notes += [f"level check at {r['frequency']:g} Hz fails, {r['unit']}: {r['level_check']}" for r in fails]
    notes += [f"warnings in the map of {row['unit']}: {int(row['notes'])}" for row in done if row["notes"] > 0]
    first = [*{row["unit"]: row for row in reversed(done)}.values()][::-1][:MOST_DRAWN]
    dots = [
        {"name": row["unit"], "impedance": impedance(row), "low": low, "high": high}
        for row in first
        for low, high in [interval(row) or (None, None)]
    ]
    caption = "R and X over ρc of each case at its first frequency, with its interval."
    picture = Picture("cases", caption, lambda path: draw_cases(dots, path), lambda: index_table(first).as_rows())
    answer = Answer(
        title=f"Campaign: {rows[0]['campaign'] or folder.name}",
        lines=[
            f"{len(units)} cases, {len(units) - len(failed)} done and {len(failed)} failed: "
            f"{'; '.join(ranges)} over ρc.",
            f"The level check fails in {len(fails)} of {sum(bool(row['level_check']) for row in done)} rows in which a "
            "pressure is known.",
        ],
        table=index_table(rows),
        caption="A row a case and frequency, as in index.csv.",
        notes=notes,
        state=FAILS if fails else "",
        pictures=[picture] if first else [],
        results=[SimpleNamespace(choices={"version": rows[0]["version"]})],
        source=folder / "index.csv",
    )
    write_page(answer, output)
    return answer
