import { afterEach, expect, it, vi } from "vitest";
import { fillText } from "../../samples/texts";
import { ALL_STATIONS, NO_FILTERS, together, whereOf } from "./RunSearch";
import { addressOf, MOST_COMPARED, othersIn, RUNS } from "./runAddress";
import { TEXTS } from "./texts";

afterEach(() => vi.unstubAllEnvs());

it("converts the form to a search and escapes quotes and backslashes", () => {
  expect(whereOf(NO_FILTERS)).toBe("");
  expect(whereOf({ ...NO_FILTERS, kind: "tracking", tag: 'a"b\\' })).toBe(
    'kind = "tracking" tag = "a\\"b\\\\"',
  );
  expect(whereOf({ ...NO_FILTERS, station: "rig-2" })).toBe('station = "rig-2"');
});

it("converts days of the local time zone to times in UTC", () => {
  const day = { ...NO_FILTERS, from: "2026-03-29", to: "2026-03-29" };
  for (const [zone, first, after] of [
    ["UTC", "2026-03-29T00:00", "2026-03-30T00:00"],
    ["Europe/Berlin", "2026-03-28T23:00", "2026-03-29T22:00"], // a day of 23 hours
    ["Pacific/Auckland", "2026-03-28T11:00", "2026-03-29T11:00"],
    ["America/Los_Angeles", "2026-03-29T07:00", "2026-03-30T07:00"],
  ]) {
    vi.stubEnv("TZ", zone);
    expect(whereOf(day)).toBe(`date >= ${first} date < ${after}`);
  }
  expect(whereOf({ ...NO_FILTERS, from: "20266-13-01" })).toBe("date >= 20266-13-01");
});

it("puts the typed text in brackets when it joins the form", () => {
  const filters = { ...NO_FILTERS, end: "tripped" };
  expect(together(" a or b ", filters)).toBe('(a or b) end = "tripped"');
  expect(together("", filters)).toBe('end = "tripped"');
  expect(together("a or b", NO_FILTERS)).toBe("a or b");
});

it("includes all stations in a saved search", () => {
  const filters = { ...NO_FILTERS, station: ALL_STATIONS };
  expect(together("a or b", filters)).toBe('(a or b) station ~ ""');
  expect(together("", filters)).toBe('station ~ ""');
});

it("writes and reads the compared runs of an address, each once", () => {
  expect(addressOf(3, [])).toBe("/runs/3");
  expect(addressOf(3, [4, 5])).toBe("/runs/3/4,5");
  expect(othersIn("4,5,4,3", 3)).toEqual({ numbers: [4, 5], problem: "" });
  expect(othersIn(undefined, 3)).toEqual({ numbers: [], problem: "" });
});

it("ignores invalid and surplus runs of an address, and reports them", () => {
  const numbers = Array.from({ length: 21 }, (_, index) => index + 2);
  expect(RUNS.exec("/runs/3/abc,4")?.groups).toMatchObject({ id: "3", others: "abc,4" });
  expect(RUNS.exec(addressOf(1, numbers))?.groups).toMatchObject({ id: "1", others: numbers.join(",") });
  expect(othersIn("abc,4,-1,1e3,0", 3)).toEqual({
    numbers: [4],
    problem: fillText(TEXTS.invalidRuns, { parts: "abc, -1, 1e3, 0" }),
  });
  const found = othersIn(numbers.join(","), 1);
  expect(found.numbers).toEqual(numbers.slice(0, MOST_COMPARED - 1));
  expect(found.problem).toBe(fillText(TEXTS.tooManyRuns, { most: 20, named: 22, runs: "21, 22" }));
});
