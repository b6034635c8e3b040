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

/** What backend/scene/proxy.py does: it writes down how far it has come, and says that it has. */
function reaches(stage: string, source: Window | null = frame().contentWindow): void {
  mark(stage);
  act(() => void window.dispatchEvent(new MessageEvent("message", { data: "stage", source })));
}

it("says what it waits for, step by step, and nothing once there is a picture", () => {
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

it("promises no seconds where there is a graphics processor", () => {
  browser.software = false;
  render(view("about:blank?"));
  reaches("drawing");
  expect(words()).toBe(TEXTS.sceneDrawing);
});

it("offers to try again when nothing comes, and takes it back when something does", () => {
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

it("says when what came is not its page, and asks for another when told to try again", () => {
  render(view("about:blank?"));
  fireEvent.load(frame());
  expect(words()).toBe(TEXTS.sceneFailed);
  const before = frame();
  fireEvent.click(screen.getByRole("button", { name: TEXTS.tryAgain }));
  expect(frame()).not.toBe(before);
  expect(frame().getAttribute("src")).not.toBe(before.getAttribute("src"));
  expect(words()).toBe(TEXTS.sceneLoadingPage);
});

it("does not take what it showed before for what it shows when its page comes again without the scene", () => {
  render(view("about:blank?"));
  reaches("shown");
  frame().contentDocument?.documentElement.removeAttribute("data-stage");
  fireEvent.load(frame());
  expect(words()).toBe(TEXTS.sceneFailed);
});

it("says that it is cut off until there is a picture again", () => {
  render(view("about:blank?"));
  reaches("shown");
  reaches("lost");
  expect(words()).toBe(TEXTS.sceneLost);
  reaches("drawing");
  expect(words()).toBe(TEXTS.sceneDrawingSlowly);
  reaches("shown");
  expect(words()).toBe("");
});

it("says that the browser has given up drawing", () => {
  render(view("about:blank?"));
  reaches("shown");
  reaches("dropped");
  expect(words()).toBe(TEXTS.sceneDropped);
  expect(again()).not.toBeNull();
});

it("listens to its own frame only, and to no stage that there is not", () => {
  render(view("about:blank?"));
  reaches("shown", window);
  expect(words()).toBe(TEXTS.sceneLoadingPage);
  reaches("all is well");
  expect(words()).toBe(TEXTS.sceneFailed);
});

it("says so where the browser cannot draw in 3D", () => {
  browser.solid = false;
  render(view("about:blank?"));
  expect(words()).toBe(TEXTS.sceneImpossible);
  expect(again()).toBeNull();
});

it("hears STOP in the view, after another camera was chosen too", () => {
  const asked = vi.fn(() => new Promise<Response>(() => {}));
  vi.stubGlobal("fetch", asked);
  const { rerender } = render(view("about:blank?1"));
  for (const address of ["about:blank?1", "about:blank?2"]) {
    rerender(view(address));
    mark("shown");
    fireEvent.load(frame());
    asked.mockClear();
    const inside = frame().contentWindow as Window;
    fireEvent.keyDown(inside.document.documentElement, { code: "KeyE", ctrlKey: true, shiftKey: true });
    expect(asked, address).toHaveBeenCalledTimes(1);
  }
});
