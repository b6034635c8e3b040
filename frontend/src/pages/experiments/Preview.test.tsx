// @vitest-environment jsdom

import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { act, cleanup, renderHook } from "@testing-library/react";
import type { ReactNode } from "react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import { useComposedPreview } from "./Preview";

// the REST client captures fetch when it is created
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  return replacement;
});

interface Asked {
  readonly text: string;
  readonly play: boolean;
  answer(body: unknown, status?: number): void;
}

let everything: Asked[] = [];
/** Requests with and without a simulation. */
const simulated = () => everything.filter(({ play }) => play);
const checked = () => everything.filter(({ play }) => !play);

beforeEach(() => {
  vi.useFakeTimers();
  everything = [];
  fetched.mockReset().mockImplementation(async (request) => {
    const { text, play } = await request.json();
    return new Promise((resolve) => {
      everything.push({
        text,
        play,
        answer: (body, status = 200) => resolve(Response.json(body, { status })),
      });
    });
  });
});

afterEach(() => {
  cleanup();
  vi.useRealTimers();
});

function start(text: string) {
  const queries = new QueryClient();
  const store = new LiveStore(0);
  const wrapper = ({ children }: { children: ReactNode }) => (
    <LiveProvider store={store}>
      <QueryClientProvider client={queries}>{children}</QueryClientProvider>
    </LiveProvider>
  );
  return renderHook((now: string) => useComposedPreview(now), { initialProps: text, wrapper });
}

const pass = (ms: number) => act(() => vi.advanceTimersByTimeAsync(ms));
const texts = () => simulated().map(({ text }) => text);

it("requests a preview when the text has not changed for a while", async () => {
  const { rerender } = start("a");
  await pass(300);
  rerender("b");
  await pass(500);
  expect(texts()).toEqual([]);
  await pass(200);
  expect(texts()).toEqual(["b"]);
});

it("simulates one text at a time, and then the newest", async () => {
  const { result, rerender } = start("a");
  await pass(700);
  for (const text of ["b", "c", "d"]) {
    rerender(text);
    await pass(2000);
  }
  expect(texts()).toEqual(["a"]);
  simulated()[0]?.answer({ title: "A", busy: false });
  await pass(10);
  expect(result.current).toMatchObject({ checked: { title: "A" }, current: false, error: null });
  await pass(700);
  expect(texts()).toEqual(["a", "d"]);
  simulated()[1]?.answer({ title: "D", busy: false });
  await pass(10);
  expect(result.current).toMatchObject({ checked: { title: "D" }, current: true });
  await pass(5000);
  expect(texts()).toEqual(["a", "d"]);
});

it("shows a refusal of the current text only, and continues with the next text", async () => {
  const { result, rerender } = start("a");
  await pass(700);
  simulated()[0]?.answer({ error: { code: "out_of_range", message: "too far" } }, 422);
  await pass(10);
  expect(result.current).toMatchObject({ current: false, error: { message: "too far" } });
  rerender("b");
  expect(result.current.error).toBeNull();
  await pass(700);
  expect(texts()).toEqual(["a", "b"]);
});

it("repeats the request while the simulator is busy, but not for an earlier text", async () => {
  const { result, rerender } = start("a");
  await pass(700);
  simulated()[0]?.answer({ title: "A", busy: true });
  await pass(10);
  expect(result.current.current).toBe(false);
  await pass(1600);
  expect(texts()).toEqual(["a", "a"]);
  simulated()[1]?.answer({ title: "A", busy: true });
  await pass(10);
  rerender("b");
  await pass(700);
  expect(texts()).toEqual(["a", "a", "b"]);
  await pass(5000);
  expect(texts()).toEqual(["a", "a", "b"]);
});

it("shows a refusal at once, also during a simulation", async () => {
  const { result, rerender } = start("a");
  await pass(700);
  expect(texts()).toEqual(["a"]);
  rerender("b");
  await pass(400);
  expect(checked().map(({ text }) => text)).toEqual(["a", "b"]);
  checked()[1]?.answer({ error: { code: "out_of_range", message: "too far" } }, 422);
  await pass(10);
  expect(result.current).toMatchObject({ current: false, error: { message: "too far" } });
  simulated()[0]?.answer({ title: "A", busy: false });
  await pass(10);
  expect(result.current).toMatchObject({
    checked: { title: "A" },
    current: false,
    error: { message: "too far" },
  });
  rerender("a");
  expect(result.current.error).toBeNull();
});
