/** One panel is shown alone and all come back. */

import { act, cleanup, fireEvent, renderHook } from "@testing-library/react";
import { afterEach, expect, it } from "vitest";
import { panelsOf, STANDARD } from "../theme/layouts";
import { useEnlarged } from "./viewport";

afterEach(cleanup);

const ALL = panelsOf(STANDARD);
const [FIRST, SECOND] = ALL.map(({ title }) => title) as [string, string];

it("shows one panel alone, another one in its place, and all after Escape", () => {
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

it("shows all again when the layout has lost the panel, or its button is pressed twice", () => {
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
