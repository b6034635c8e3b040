import { expect, it } from "vitest";
import { addressOf, othersIn } from "./address";
import { ALL_STATIONS, NO_FILTERS, together, whereOf } from "./filters";

it("says the form as a search, with what would end a quote behind a backslash", () => {
  expect(whereOf(NO_FILTERS)).toBe("");
  expect(whereOf({ ...NO_FILTERS, kind: "tracking", tag: 'a"b\\', to: "2026-03-31" })).toBe(
    'kind = "tracking" tag = "a\\"b\\\\" date <= 2026-03-31',
  );
  expect(whereOf({ ...NO_FILTERS, station: ALL_STATIONS })).toBe("");
  expect(whereOf({ ...NO_FILTERS, station: "rig-2" })).toBe('station = "rig-2"');
});

it("keeps what is typed apart from the form, whatever it says", () => {
  const filters = { ...NO_FILTERS, end: "tripped" };
  expect(together(" a or b ", filters)).toBe('(a or b) end = "tripped"');
  expect(together("", filters)).toBe('end = "tripped"');
  expect(together("a or b", NO_FILTERS)).toBe("a or b");
});

it("has the runs beside a run in its address, each once", () => {
  expect(addressOf(3, [])).toBe("/runs/3");
  expect(addressOf(3, [4, 5])).toBe("/runs/3/4,5");
  expect(othersIn("4,5,4,3", 3)).toEqual([4, 5]);
  expect(othersIn(undefined, 3)).toEqual([]);
});
