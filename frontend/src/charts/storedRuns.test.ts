import { expect, it, vi } from "vitest";

const ranges = vi.hoisted(() => ({
  rangeStatistics: vi.fn(),
  rangeSpectra: vi.fn(),
  valuesAt: vi.fn(),
  rangeFile: vi.fn(
    (run: number, { from_s, to_s }: { from_s: number; to_s: number }, names: readonly string[]) =>
      [run, from_s, to_s, ...names].join(" "),
  ),
}));
vi.mock("../service/api/recordings", () => ranges);

// Tests without a DOM share their modules: another one may have loaded this one without the stub.
vi.resetModules();
const { StoredRuns } = await import("./storedRuns");

const quiet = () => ({ signal: new AbortController().signal, onShare: vi.fn() });
const NUMBERS = {
  unit: "rad",
  values: 3,
  without_value: 1,
  minimum: -1,
  minimum_s: 2,
  maximum: 4,
  maximum_s: 3,
};
const MORE = { mean: 1, deviation: null };

/** Run 7 of 10 s, and run 9 of 4 s that starts 6.5 s later on the axis. */
const runs = new StoredRuns([
  { id: 7, duration_s: 10 },
  { id: 9, duration_s: 4, offset_s: 6.5 },
]);

it("requests the part of the range of each run, on its own axis, one after the other", async () => {
  const answers = (run: number, { from_s, to_s }: { from_s: number; to_s: number }, names: string[]) => ({
    run,
    from_s,
    to_s,
    samples: 100,
    missing: 2,
    signals: Object.fromEntries(names.map((name) => [name, { ...NUMBERS, ...MORE }])),
  });
  ranges.rangeStatistics.mockImplementation(async (run, range, names, { onShare }) => {
    onShare(0.5);
    return answers(run, range, names);
  });
  const waiting = quiet();
  const found = await runs.statistics(["q", "S", "q′"], { from_s: -1, to_s: 20 }, waiting);
  const calls = ranges.rangeStatistics.mock.calls.map(([run, range, names]) => [run, range, names]);
  expect(calls).toEqual([
    [7, { from_s: 0, to_s: 9.999 }, ["q", "S"]],
    [9, { from_s: 0, to_s: 3.999 }, ["q"]],
  ]);
  expect(waiting.onShare.mock.calls.map(([share]) => share)).toEqual([0.25, 0.75]);
  expect(found.basis.map(({ of, range }) => [of, range?.from_s])).toEqual([
    ["run 7", 0],
    ["run 9", 6.5],
  ]);
  expect(found.signals.get("q′")).toMatchObject({ minimum: -1, minimum_s: 8.5, values: 3, withoutValue: 1 });
  expect(found.signals.get("q")?.deviation).toBeNaN();
});

it("omits a run outside the range, and its file", async () => {
  ranges.rangeStatistics.mockClear();
  const found = await runs.statistics(["q", "q′"], { from_s: 1, to_s: 2 }, quiet());
  expect(ranges.rangeStatistics).toHaveBeenCalledTimes(1);
  expect(found.signals.has("q′")).toBe(false);
  expect(runs.file(["q", "q′"], { from_s: 1, to_s: 2 })).toBe("7 1 2 q");
  expect(runs.file(["q"], { from_s: 10.2, to_s: 10.4 })).toBeNull();
});

it("computes the amplitude from the density", async () => {
  const spectrum = { reason: "", density: [2, 8], step_Hz: 0.5, noise_bandwidth_Hz: 0.25, used: 6 };
  const whole = { ...spectrum, unit: "rad", values: 9, without_value: 0, segment: 6, segments: 1 };
  const none = { ...whole, reason: "too few", density: [] };
  ranges.rangeSpectra.mockResolvedValue({
    from_s: 0,
    to_s: 1,
    samples: 9,
    missing: 0,
    signals: { q: whole, S: none },
  });
  const found = await new StoredRuns([{ id: 7, duration_s: 10 }]).spectra(
    ["q", "S"],
    { from_s: 0, to_s: 1 },
    quiet(),
  );
  expect([...(found.signals.get("q")?.frequencies ?? [])]).toEqual([0.5, 1]);
  expect([...(found.signals.get("q")?.amplitude ?? [])]).toEqual([1, 2]);
  expect([...found.reasons]).toEqual([["S", "too few"]]);
});

it("returns NaN if the run has no sample at that time", async () => {
  ranges.valuesAt.mockImplementation(async (run: number, times: number[]) => ({
    run,
    period_s: 0.001,
    // the recording has no samples after 1 s
    moments: times.map((at_s) => ({ at_s, t: Math.min(at_s, 1), values: { q: run } })),
  }));
  const found = await runs.values(["q", "q′"], [0.5, 3, 7, 99], new AbortController().signal);
  expect(found.map((moment) => [moment.get("q"), moment.get("q′")])).toEqual([
    [7, undefined],
    [undefined, undefined],
    [undefined, 9],
    [undefined, undefined],
  ]);
});

it("reads the first and the last sample of a recording despite rounding of the times", async () => {
  ranges.valuesAt.mockImplementation(async (run: number, times: number[]) => ({
    run,
    period_s: 0.001,
    moments: times.map((at_s) => ({ at_s, t: at_s, values: { q: at_s } })),
  }));
  for (const duration_s of [3, 20, 7.003, 0.1]) {
    for (const offset_s of [0, 0.1, 6.7]) {
      const one = new StoredRuns([{ id: 7, duration_s, offset_s }]);
      const ends = [offset_s, offset_s + duration_s, offset_s - 0.001, offset_s + duration_s + 0.001];
      const found = await one.values(["q"], ends, new AbortController().signal);
      const values = found.map((moment) => moment.get("q"));
      expect(values[0]).toBeCloseTo(0, 9);
      expect(values[1]).toBeCloseTo(duration_s - 0.001, 9);
      expect(values.slice(2)).toEqual([undefined, undefined]);
    }
  }
});
