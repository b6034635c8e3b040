import { act, renderHook } from "@testing-library/react";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import type { Figures } from "../samples/analysis";
import { clockTime } from "../samples/format";
import type { TimeRange } from "../samples/timeSeries";
import type { Waiting } from "../service/api/recordings";
import { describeBasis, grouped, useStatistics } from "./StatisticsTable";
import type { StoredData } from "./storedRuns";

describe("useStatistics", () => {
  const NAMES = ["q"];
  const FIGURES: Figures = { basis: [], signals: new Map() };

  interface PendingRequest extends Waiting {
    readonly range: TimeRange;
    answer(figures: Figures): void;
    refuse(error: Error): void;
  }

  let requests: PendingRequest[] = [];
  const stored = {
    statistics: (_names: readonly string[], range: TimeRange, waiting: Waiting) =>
      new Promise<Figures>((answer, refuse) => requests.push({ ...waiting, range, answer, refuse })),
  } as StoredData;

  beforeEach(() => {
    requests = [];
    vi.useFakeTimers();
  });

  afterEach(() => void vi.useRealTimers());

  function watched() {
    const seen = { range: { from_s: 0, to_s: 600 } };
    const table = () => ({ raw: true, width_s: 0.001, t: new Float64Array(0), columns: [] });
    const hook = renderHook(() => useStatistics({ names: NAMES, range: () => seen.range, table }, stored));
    return { seen, ...hook };
  }

  const pass = (ms: number) => act(() => vi.advanceTimersByTimeAsync(ms));

  it("returns the progress, and the results of the previous range until the new ones are complete", async () => {
    const { seen, result } = watched();
    act(() => requests[0]?.onShare(0.4));
    expect(result.current).toMatchObject({ figures: null, share: 0.4 });
    await act(async () => requests[0]?.answer(FIGURES));
    expect(result.current).toMatchObject({ figures: FIGURES, share: null });
    seen.range = { from_s: 1, to_s: 2 };
    await pass(1000);
    expect(requests.map(({ range }) => range.from_s)).toEqual([0, 1]);
    expect(result.current).toMatchObject({ figures: FIGURES, share: 0 });
  });

  it("waits until the range is stable, and aborts the previous request", async () => {
    const { seen, unmount } = watched();
    for (let n = 1; n < 20; n++) {
      seen.range = { from_s: n, to_s: n + 10 };
      await pass(200);
    }
    expect(requests).toHaveLength(1);
    await pass(400);
    expect(requests.map(({ range, signal }) => [range.from_s, signal.aborted])).toEqual([
      [0, true],
      [19, false],
    ]);
    unmount();
    expect(requests[1]?.signal.aborted).toBe(true);
  });

  it("returns the reason for missing statistics", async () => {
    const { result } = watched();
    await act(async () => requests[0]?.refuse(new Error("out of reach")));
    expect(result.current).toEqual({ figures: null, share: null, problem: "out of reach" });
  });
});

describe("basis", () => {
  const timeText = (time_s: number) => clockTime(time_s, 0.001);
  const WHOLE = {
    of: "",
    range: { from_s: 0, to_s: 599.999 },
    samples: 599_300,
    missing: 700,
    bucket_s: null,
  };

  it("states the samples of statistics, and the number of missing ones", () => {
    expect(describeBasis([WHOLE], timeText)).toBe(
      "every sample between 0:00.000 and 9:59.999: 599\u202f300 samples, 700 missing",
    );
  });

  it("states them for each recording, and for one without samples", () => {
    const none = { ...WHOLE, of: "run 3", range: null, samples: 0 };
    const words = describeBasis([{ ...WHOLE, of: "run 2", missing: 0 }, none], timeText);
    expect(words).toBe(
      "run 2: every sample between 0:00.000 and 9:59.999: 599\u202f300 samples; run 3: no sample in this range",
    );
    expect(describeBasis([], timeText)).toBe("no sample in this range");
  });

  it("does not describe an envelope as every sample", () => {
    const words = describeBasis([{ ...WHOLE, bucket_s: 0.3, samples: 2000 }], timeText);
    expect(words).toBe("min/max per 0.300 s between 0:00.000 and 9:59.999: 2\u202f000 pairs");
  });

  it("groups digits by three", () => {
    expect([0, 999, 1000, 1_234_567].map(grouped)).toEqual(["0", "999", "1\u202f000", "1\u202f234\u202f567"]);
  });
});
