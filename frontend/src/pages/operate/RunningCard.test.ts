import { expect, it } from "vitest";
import { fillText } from "../../samples/texts";
import { describeAbort } from "./RunningCard";
import { TEXTS } from "./texts";

it("describes an abort: in a pause the run remains complete and the following runs are dropped", () => {
  expect(describeAbort({ phase: "program", run: 12, following: 2 })).toBe(TEXTS.keptAsStopped);
  expect(describeAbort({ phase: "paused", run: 12, following: 2 })).toBe(
    fillText(TEXTS.keptAsComplete, { run: 12, runs: "2 remaining runs" }),
  );
  expect(describeAbort({ phase: "paused", run: 12, following: 1 })).toContain("; 1 remaining run will");
});
