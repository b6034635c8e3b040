import { expect, test } from "vitest";
import { liveUrl } from "./address";

test.each([
  ["http://127.0.0.1:8000/#/operate", "ws://127.0.0.1:8000/api/live"],
  ["https://rig.lab/sinew/?a=1#/runs/3", "wss://rig.lab/sinew/api/live"],
  ["https://rig.lab/a/b/index.html", "wss://rig.lab/a/b/api/live"],
  ["http://[::1]:8000/?back=/x/y", "ws://[::1]:8000/api/live"],
])("the live stream of the page at %s is beside it", (page, stream) => {
  expect(liveUrl(page)).toBe(stream);
});
