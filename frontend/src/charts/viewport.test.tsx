/** Shows one panel alone, and all again. */

import { act, cleanup, fireEvent, renderHook } from "@testing-library/react";
import { afterEach, describe, expect, it } from "vitest";
import { panelsOf, STANDARD } from "../theme/layouts";
import { following, held, LIVE, panned, useEnlarged, visibleRange, withSpan, zoomed } from "./viewport";

describe("useEnlarged", () => {
  afterEach(cleanup);

  const ALL = panelsOf(STANDARD);
  const [FIRST, SECOND] = ALL.map(({ title }) => title) as [string, string];

  it("shows one panel alone, then another one, and all after Escape", () => {
    const { result } = renderHook(() => useEnlarged(ALL));
    const shown = () => result.current.panels.map(({ title }) => title);
    expect(shown()).toEqual(ALL.map(({ title }) => title));
    act(() => result.current.enlarge(FIRST));
    expect([shown(), result.current.enlarged]).toEqual([[FIRST], FIRST]);
    act(() => result.current.enlarge(SECOND));
    expect(shown()).toEqual([SECOND]);
    fireEvent.keyDown(document.documentElement, { key: "Escape", code: "Escape" });
    expect([shown().length, result.current.enlarged]).toEqual([ALL.length, null]);
  });

  it("shows all when the layout no longer contains the panel, or after a second press of its button", () => {
    const { result, rerender } = renderHook(({ panels }) => useEnlarged(panels), {
      initialProps: { panels: ALL },
    });
    act(() => result.current.enlarge(FIRST));
    rerender({ panels: ALL.slice(1) });
    expect([result.current.panels.length, result.current.enlarged]).toEqual([ALL.length - 1, null]);
    act(() => result.current.enlarge(SECOND));
    act(() => result.current.enlarge(SECOND));
    expect(result.current.enlarged).toBeNull();
  });
});

describe("viewport", () => {
  it("follows the newest sample until it is held", () => {
    expect(visibleRange(LIVE, 100)).toEqual({ from_s: 80, to_s: 100 });
    const still = held(LIVE, 100);
    expect(visibleRange(still, 130)).toEqual({ from_s: 80, to_s: 100 });
    expect(visibleRange(following(still), 130).to_s).toBe(130);
  });

  it("zooms a held view about the pointer, also while samples arrive", () => {
    const view = zoomed(held(LIVE, 100), 0.5, 85, 120);
    expect(visibleRange(view, 500)).toEqual({ from_s: 82.5, to_s: 92.5 });
  });

  it("continues to follow while it zooms", () => {
    expect(visibleRange(zoomed(LIVE, 0.25, 90, 120), 100)).toEqual({ from_s: 95, to_s: 100 });
  });

  it("limits spans to between 20 ms and the longest one", () => {
    expect(zoomed(LIVE, 1e-9, 0, 120).span_s).toBe(0.02);
    expect(zoomed(LIVE, 1e9, 0, 120).span_s).toBe(120);
  });

  it("limits panning to the range of the data", () => {
    expect(panned(LIVE, -5, 0, 100).end_s).toBe(95);
    expect(panned(LIVE, -500, 0, 100).end_s).toBe(2);
    expect(panned(LIVE, 500, 0, 100).end_s).toBe(110);
  });

  it("changes the left edge of a held view with its span", () => {
    expect(visibleRange(withSpan(held(LIVE, 100), 5), 900)).toEqual({ from_s: 95, to_s: 100 });
  });
});
