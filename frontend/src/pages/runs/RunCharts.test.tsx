import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { act, renderHook, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { fillText } from "../../samples/texts";
import { LONG_S, together, useExcerpts } from "./RunCharts";
import { TEXTS } from "./texts";

const SIGNALS = ["q", "q - q_ref", "S"];

/** Pending requests by their signals, with the function that answers each. */
const asked = new Map<string, (answer: Response) => void>();

beforeEach(() => {
  vi.stubGlobal("fetch", (request: Request) => {
    const signals = new URL(request.url).searchParams.get("signals") as string;
    return new Promise<Response>((answer) => asked.set(signals, answer));
  });
});

afterEach(() => {
  asked.clear();
  vi.unstubAllGlobals();
});

/** Returns one bucket of `count` signals; signal n has the extremes n and n + 10. */
function curves(count: number): Response {
  const message = new ArrayBuffer(24 + 8 * count);
  const view = new DataView(message);
  view.setFloat64(0, 1, true);
  view.setUint32(16, 1, true);
  view.setUint32(20, 2, true);
  for (let n = 0; n < count; n++) {
    view.setFloat32(24 + 8 * n, n, true);
    view.setFloat32(28 + 8 * n, 10 + n, true);
  }
  return new Response(message, { headers: { "Content-Type": "application/octet-stream" } });
}

function used(to_s: number) {
  const one = { id: 7, stretch: { from_s: 0, to_s }, wanted: true };
  const client = new QueryClient({ defaultOptions: { queries: { retry: false } } });
  return renderHook(() => useExcerpts([one], 100, SIGNALS), {
    wrapper: ({ children }) => <QueryClientProvider client={client}>{children}</QueryClientProvider>,
  }).result;
}

it("loads all signals of a short range with one request", async () => {
  const result = used(LONG_S);
  await waitFor(() => expect([...asked.keys()]).toEqual([SIGNALS.join(",")]));
  await act(async () => asked.get(SIGNALS.join(","))?.(curves(3)));
  await waitFor(() => expect(Object.keys(result.current.excerpts[0]?.signals ?? {})).toEqual(SIGNALS));
  expect(result.current.pending).toBe("");
});

it("shows stored summaries of a long range before computed signals, and reports these as pending", async () => {
  const result = used(LONG_S + 1);
  await waitFor(() => expect([...asked.keys()].sort()).toEqual(["q - q_ref", "q,S"]));
  await act(async () => asked.get("q,S")?.(curves(2)));
  await waitFor(() => expect(Object.keys(result.current.excerpts[0]?.signals ?? {})).toEqual(["q", "S"]));
  expect(result.current.pending).toBe(fillText(TEXTS.computing, { signals: "q − q_ref" }));
  await act(async () => asked.get("q - q_ref")?.(curves(1)));
  await waitFor(() => expect(result.current.pending).toBe(""));
  const { signals } = result.current.excerpts[0] as NonNullable<(typeof result.current.excerpts)[0]>;
  expect([signals.q?.maximum[0], signals.S?.maximum[0], signals["q - q_ref"]?.maximum[0]]).toEqual([
    10, 11, 10,
  ]);
});

it("shows why computed signals are not available", async () => {
  const result = used(LONG_S + 1);
  await waitFor(() => expect(asked.size).toBe(2));
  const died = { code: "unavailable", message: "the process that computes this died over it twice" };
  await act(async () => asked.get("q - q_ref")?.(Response.json({ error: died }, { status: 503 })));
  await waitFor(() =>
    expect(result.current.pending).toContain(
      fillText(TEXTS.notComputed, { signals: "q − q_ref", reason: "" }),
    ),
  );
  expect(result.current.pending).toContain(died.message);
});

it("omits a part with different buckets", () => {
  const excerpt = (times: number[]) => ({ raw: false, width_s: 1, t: Float64Array.from(times), signals: {} });
  const first = excerpt([0, 1]);
  expect(together(first, excerpt([0, 1, 2]))).toBe(first);
  expect(together(first, excerpt([0, 1]))).not.toBe(first);
});
