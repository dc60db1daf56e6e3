"""The page of the live bridge with recorded messages, for whoever works on it: `python tests/live/feeder.py [PORT]`.

It serves aspnn/live/page with the headers of the real server and plays tests/live/situations.json.gz in a loop, one message
a second. What-if answers are the recorded ones, whatever is asked; orders and limits are accepted and have no effect.
"""

import asyncio
import copy
import gzip
import json
import sys
from pathlib import Path

import uvicorn
from fastapi import FastAPI, WebSocket, WebSocketDisconnect
from fastapi.responses import FileResponse, JSONResponse
from fastapi.staticfiles import StaticFiles

HERE = Path(__file__).parent
PAGE = HERE.parents[1] / "aspnn" / "live" / "page"
CHART = HERE.parents[1] / "data" / "charts" / "sound.geojson"
POLICY = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'"


def recording() -> dict:
    """The recorded messages (`situations`) and one answer to a what-if question (`whatif`)."""
    return json.loads(gzip.decompress((HERE / "situations.json.gz").read_bytes()))


def crowded(recorded: dict, count: int = 50) -> dict:
    """What was recorded with `count` targets: the first of each message again and again, each 130 m north of the last."""
    situations = copy.deepcopy(recorded["situations"])
    for message in situations:
        first = message["targets"][0]
        message["targets"] = [
            moved(first, 0.0012 * k) | {"id": str(257_000_100 + k), "name": None} for k in range(count)
        ]
    return {**recorded, "situations": situations}


def moved(target: dict, north: float) -> dict:
    """A target some degrees further north, with all that is hers."""
    found = copy.deepcopy(target)
    found["lat"] += north
    found["path"]["lat"] = [lat + north for lat in found["path"]["lat"]]
    rings = [found["outline"] or [], *(mark["ring"] for mark in found["outlines"])]
    for place in (place for ring in rings for place in ring):
        place[1] += north
    return found


def feeder(recorded: dict, period: float = 1.0, chart_file: Path = CHART) -> FastAPI:
    """An app that plays what was `recorded` in a loop to each client from its start, one message every `period` [s]."""
    app = FastAPI()

    @app.middleware("http")
    async def policy(request, call_next):
        answer = await call_next(request)
        answer.headers["Content-Security-Policy"] = POLICY
        return answer

    @app.websocket("/ws")
    async def ws(socket: WebSocket) -> None:
        await socket.accept()
        number = 0
        try:
            while True:
                await socket.send_json(recorded["situations"][number % len(recorded["situations"])])
                number += 1
                await asyncio.sleep(period)
        except WebSocketDisconnect:
            return

    @app.get("/api/chart")
    async def chart() -> FileResponse:
        return FileResponse(chart_file, media_type="application/geo+json")

    @app.post("/api/whatif")
    async def whatif(asked: dict) -> dict:
        found = {key: value for key, value in recorded["whatif"].items() if key != "asked"}
        if asked.get("plan") is None:
            found["paths"] = [path for path in found["paths"] if path["plan"] is None]
        if asked.get("clear") is None:
            found |= {"paths": [{**path, "point": None} for path in found["paths"]], "choice": None}
        return found

    @app.post("/api/order")
    @app.post("/api/limits")
    async def accept(asked: dict) -> JSONResponse:
        return JSONResponse(asked)

    app.mount("/", StaticFiles(directory=PAGE, html=True))
    return app


if __name__ == "__main__":
    uvicorn.run(
        feeder(recording()), host="127.0.0.1", port=int(sys.argv[1]) if len(sys.argv) > 1 else 8010, log_level="warning"
    )
