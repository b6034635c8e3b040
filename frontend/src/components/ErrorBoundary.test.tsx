/** A part of the page that throws shows its error, and the other parts remain. */

import { MantineProvider } from "@mantine/core";
import { cleanup, fireEvent, type RenderResult, render, screen } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { ErrorBoundary } from "./ErrorBoundary";
import { TEXTS } from "./texts";

const broken = { now: true };
let shown: RenderResult;

function Part() {
  if (broken.now) throw new Error("no such sample");
  return <p>all well</p>;
}

const page = (at: string) => (
  <MantineProvider>
    <ErrorBoundary of="Charts" at={at}>
      <Part />
    </ErrorBoundary>
    <p>beside</p>
  </MantineProvider>
);

beforeEach(() => {
  broken.now = true;
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  vi.spyOn(console, "error").mockImplementation(() => undefined);
  shown = render(page("run 1"));
});
afterEach(() => {
  cleanup();
  vi.restoreAllMocks();
  vi.unstubAllGlobals();
});

it("names the part and the reason, and does not affect other parts", () => {
  expect(screen.getByRole("alert", { name: "Charts failed" }).textContent).toContain("no such sample");
  expect(screen.getByText("beside")).toBeTruthy();
});

it("shows the part again if the cause is gone, and fails again otherwise", () => {
  const again = () => fireEvent.click(screen.getByRole("button", { name: TEXTS.retry }));
  again();
  expect(screen.getByRole("alert", { name: "Charts failed" })).toBeTruthy();
  broken.now = false;
  again();
  expect(screen.getByText("all well")).toBeTruthy();
});

it("clears the error when its content changes", () => {
  broken.now = false;
  shown.rerender(page("run 1"));
  expect(screen.queryByText("all well")).toBeNull();
  shown.rerender(page("run 2"));
  expect(screen.getByText("all well")).toBeTruthy();
});
