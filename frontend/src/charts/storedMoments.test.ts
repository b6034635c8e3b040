import { expect, it, vi } from "vitest";
import type { Moment, StoredData } from "./storedRuns";
import { StoredMoments } from "./storedRuns";

/** A recording in which q is ten times the time, and whose responses the test releases. */
function recording() {
  const requests: { times: readonly number[]; signal: AbortSignal; answer(): void; refuse(): void }[] = [];
  const values: StoredData["values"] = (_names, times, signal) =>
    new Promise<Moment[]>((resolve, reject) => {
      const moments = times.map((time_s) => new Map([["q", 10 * time_s]]));
      requests.push({
        times,
        signal,
        answer: () => resolve(moments),
        refuse: () => reject(new Error("out of reach")),
      });
    });
  return { requests, moments: new StoredMoments({ values } as StoredData, ["q"]) };
}

it("requests values once the times are stable", async () => {
  const { requests, moments } = recording();
  moments.want([1, 2]);
  moments.want([1, 2.5]);
  expect(requests).toHaveLength(0);
  moments.want([1, 2.5]);
  moments.want([1, 2.5]);
  expect(requests.map(({ times }) => times)).toEqual([[1, 2.5]]);
  expect(moments.at("q", 1)).toBeNull();
  requests[0]?.answer();
  await vi.waitFor(() => expect(moments.at("q", 2.5)).toBe(25));
  expect(moments.at("S", 1)).toBeNaN();
});

it("requests only new times, and aborts requests for other times", async () => {
  const { requests, moments } = recording();
  for (const times of [[1], [1]]) moments.want(times);
  requests[0]?.answer();
  await vi.waitFor(() => expect(moments.at("q", 1)).toBe(10));
  for (const times of [
    [1, 3],
    [1, 3],
    [1, 4],
    [1, 4],
  ])
    moments.want(times);
  expect(requests.map(({ times }) => times)).toEqual([[1], [3], [4]]);
  expect(requests[1]?.signal.aborted).toBe(true);
  requests[2]?.answer();
  await vi.waitFor(() => expect(moments.at("q", 4)).toBe(40));
  expect(moments.at("q", 1)).toBe(10);
});

it("returns the reason for missing values", async () => {
  const { requests, moments } = recording();
  for (const times of [[1], [1]]) moments.want(times);
  requests[0]?.refuse();
  await vi.waitFor(() => expect(moments.problem).toBe("out of reach"));
  expect(moments.at("q", 1)).toBeNull();
});
