import { expect, it } from "vitest";
import { describeAbort } from "./RunningCard";

it("says what an abort leaves: in a pause the run is complete, and those that follow are not begun", () => {
  expect(describeAbort({ phase: "program", run: 12, following: 2 })).toBe("The run is kept as stopped.");
  expect(describeAbort({ phase: "paused", run: 12, following: 2 })).toBe(
    "Run 12 is complete and stays so; 2 runs of its order will not be begun.",
  );
  expect(describeAbort({ phase: "paused", run: 12, following: 1 })).toContain("; 1 run of its order");
});
