import { MantineProvider } from "@mantine/core";
import { act, cleanup, fireEvent, render, screen } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";

const browser = { solid: true, software: true };
vi.mock("../drawing/canvas", () => ({
  canDrawSolid: () => browser.solid,
  paintsInSoftware: () => browser.software,
}));

import { fillText } from "../samples/texts";
import { PATIENCE_S, SceneFrame } from "./SceneFrame";
import { TEXTS } from "./texts";

beforeEach(() => {
  vi.useFakeTimers();
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  Object.assign(browser, { solid: true, software: true });
});
afterEach(() => {
  cleanup();
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

const view = (address: string) => (
  <MantineProvider>
    <SceneFrame address={address} title="3D view" />
  </MantineProvider>
);
const frame = () => screen.getByTitle<HTMLIFrameElement>("3D view");
const words = () =>
  screen.getByRole("status", { name: fillText(TEXTS.sceneStatus, { title: "3D view" }) }).textContent;
const again = () => screen.queryByRole("button", { name: TEXTS.tryAgain });

function mark(stage: string): void {
  frame().contentDocument?.documentElement.setAttribute("data-stage", stage);
}

/** Stub of backend/scene/proxy.py: writes its stage and sends a message. */
function reaches(stage: string, source: Window | null = frame().contentWindow): void {
  mark(stage);
  act(() => void window.dispatchEvent(new MessageEvent("message", { data: "stage", source })));
}

it("shows each stage, and no text while it draws", () => {
  render(view("about:blank?"));
  expect(words()).toBe(TEXTS.sceneLoadingPage);
  reaches("connecting");
  expect(words()).toBe(TEXTS.sceneLoadingData);
  fireEvent.load(frame());
  expect(words()).toBe(TEXTS.sceneLoadingData);
  reaches("drawing");
  expect(words()).toBe(TEXTS.sceneDrawingSlowly);
  reaches("shown");
  expect(words()).toBe("");
  expect(again()).toBeNull();
});

it("does not mention slow drawing if there is a GPU", () => {
  browser.software = false;
  render(view("about:blank?"));
  reaches("drawing");
  expect(words()).toBe(TEXTS.sceneDrawing);
});

it("offers another attempt after a delay, and withdraws it when the view loads", () => {
  render(view("about:blank?"));
  act(() => void vi.advanceTimersByTime(PATIENCE_S * 1000 - 1));
  expect(again()).toBeNull();
  act(() => void vi.advanceTimersByTime(1));
  expect(words()).toBe(fillText(TEXTS.sceneLatePage, { time: PATIENCE_S }));
  expect(again()).not.toBeNull();
  reaches("connecting");
  expect(words()).toBe(TEXTS.sceneLoadingData);
  expect(again()).toBeNull();
});

it("reports another document, and requests a new one on another attempt", () => {
  render(view("about:blank?"));
  fireEvent.load(frame());
  expect(words()).toBe(TEXTS.sceneFailed);
  const before = frame();
  fireEvent.click(screen.getByRole("button", { name: TEXTS.tryAgain }));
  expect(frame()).not.toBe(before);
  expect(frame().getAttribute("src")).not.toBe(before.getAttribute("src"));
  expect(words()).toBe(TEXTS.sceneLoadingPage);
});

it("does not show an earlier stage when another document has loaded", () => {
  render(view("about:blank?"));
  reaches("shown");
  frame().contentDocument?.documentElement.removeAttribute("data-stage");
  fireEvent.load(frame());
  expect(words()).toBe(TEXTS.sceneFailed);
});

it("reports a lost connection until it draws again", () => {
  render(view("about:blank?"));
  reaches("shown");
  reaches("lost");
  expect(words()).toBe(TEXTS.sceneLost);
  reaches("drawing");
  expect(words()).toBe(TEXTS.sceneDrawingSlowly);
  reaches("shown");
  expect(words()).toBe("");
});

it("reports that the browser has stopped drawing", () => {
  render(view("about:blank?"));
  reaches("shown");
  reaches("dropped");
  expect(words()).toBe(TEXTS.sceneDropped);
  expect(again()).not.toBeNull();
});

it("ignores other frames and unknown stages", () => {
  render(view("about:blank?"));
  reaches("shown", window);
  expect(words()).toBe(TEXTS.sceneLoadingPage);
  reaches("all is well");
  expect(words()).toBe(TEXTS.sceneFailed);
});

it("reports that the browser cannot draw in 3D", () => {
  browser.solid = false;
  render(view("about:blank?"));
  expect(words()).toBe(TEXTS.sceneImpossible);
  expect(again()).toBeNull();
});

it("receives the keys of STOP in the view, also after a change of the camera", () => {
  const fetched = vi.fn(() => new Promise<Response>(() => {}));
  vi.stubGlobal("fetch", fetched);
  const { rerender } = render(view("about:blank?1"));
  for (const address of ["about:blank?1", "about:blank?2"]) {
    rerender(view(address));
    mark("shown");
    fireEvent.load(frame());
    fetched.mockClear();
    const inside = frame().contentWindow as Window;
    fireEvent.keyDown(inside.document.documentElement, { code: "KeyE", ctrlKey: true, shiftKey: true });
    expect(fetched, address).toHaveBeenCalledTimes(1);
  }
});
