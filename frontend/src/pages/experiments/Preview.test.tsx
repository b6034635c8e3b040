// @vitest-environment jsdom

import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { act, cleanup, renderHook } from "@testing-library/react";
import type { ReactNode } from "react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import { useComposedPreview } from "./Preview";

// the REST client takes hold of fetch when it is made
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
/** What is to be played, and what is looked over only. */
const played = () => everything.filter(({ play }) => play);
const looked = () => everything.filter(({ play }) => !play);

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
const texts = () => played().map(({ text }) => text);

it("asks once a text has come to rest", async () => {
  const { rerender } = start("a");
  await pass(300);
  rerender("b");
  await pass(500);
  expect(texts()).toEqual([]);
  await pass(200);
  expect(texts()).toEqual(["b"]);
});

it("has one under way at a time, and after it the newest text", async () => {
  const { result, rerender } = start("a");
  await pass(700);
  for (const text of ["b", "c", "d"]) {
    rerender(text);
    await pass(2000);
  }
  expect(texts()).toEqual(["a"]);
  played()[0]?.answer({ title: "A", busy: false });
  await pass(10);
  expect(result.current).toMatchObject({ checked: { title: "A" }, current: false, error: null });
  await pass(700);
  expect(texts()).toEqual(["a", "d"]);
  played()[1]?.answer({ title: "D", busy: false });
  await pass(10);
  expect(result.current).toMatchObject({ checked: { title: "D" }, current: true });
  await pass(5000);
  expect(texts()).toEqual(["a", "d"]);
});

it("tells a refusal of the text that stands there alone, and goes on with the next one", async () => {
  const { result, rerender } = start("a");
  await pass(700);
  played()[0]?.answer({ error: { code: "out_of_range", message: "too far" } }, 422);
  await pass(10);
  expect(result.current).toMatchObject({ current: false, error: { message: "too far" } });
  rerender("b");
  expect(result.current.error).toBeNull();
  await pass(700);
  expect(texts()).toEqual(["a", "b"]);
});

it("asks again while there is no place, and not for an earlier text", async () => {
  const { result, rerender } = start("a");
  await pass(700);
  played()[0]?.answer({ title: "A", busy: true });
  await pass(10);
  expect(result.current.current).toBe(false);
  await pass(1600);
  expect(texts()).toEqual(["a", "a"]);
  played()[1]?.answer({ title: "A", busy: true });
  await pass(10);
  rerender("b");
  await pass(700);
  expect(texts()).toEqual(["a", "a", "b"]);
  await pass(5000);
  expect(texts()).toEqual(["a", "a", "b"]);
});

it("tells at once what is refused, whatever is being played", async () => {
  const { result, rerender } = start("a");
  await pass(700);
  expect(texts()).toEqual(["a"]);
  rerender("b");
  await pass(400);
  expect(looked().map(({ text }) => text)).toEqual(["a", "b"]);
  looked()[1]?.answer({ error: { code: "out_of_range", message: "too far" } }, 422);
  await pass(10);
  expect(result.current).toMatchObject({ current: false, error: { message: "too far" } });
  played()[0]?.answer({ title: "A", busy: false });
  await pass(10);
  expect(result.current).toMatchObject({
    checked: { title: "A" },
    current: false,
    error: { message: "too far" },
  });
  rerender("a");
  expect(result.current.error).toBeNull();
});
