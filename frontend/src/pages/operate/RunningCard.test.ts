import { expect, it } from "vitest";
import { fillText } from "../../samples/texts";
import { describeAbort } from "./RunningCard";
import { TEXTS } from "./texts";

it("says what an abort leaves: in a pause the run is complete, and those that follow are not begun", () => {
  expect(describeAbort({ phase: "program", run: 12, following: 2 })).toBe(TEXTS.keptAsStopped);
  expect(describeAbort({ phase: "paused", run: 12, following: 2 })).toBe(
    fillText(TEXTS.keptAsComplete, { run: 12, runs: "2 remaining runs" }),
  );
  expect(describeAbort({ phase: "paused", run: 12, following: 1 })).toContain("; 1 remaining run will");
});
