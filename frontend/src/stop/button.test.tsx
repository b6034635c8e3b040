/** STOP without the application: its button, its keys and its notice. */
import { beforeEach, expect, it, vi } from "vitest";

const fetched = vi.fn<(request: Request) => Promise<Response>>();
vi.stubGlobal("fetch", fetched);

import { observeState, registerDisplay, stopState } from "./stop";
import { TEXTS } from "./texts";

const PROOF = { arrived_tick: 1000, zero_tick: 1001, milliseconds: 1 };
const LOST = { kind: "unconfirmed" } as const;

const proof = async () => new Response(JSON.stringify(PROOF), { status: 200 });
const button = () => document.querySelector("button[aria-label=STOP]") as HTMLButtonElement;
const notice = () => document.querySelector("[role=alert][aria-label=STOP]") as HTMLElement;
const becomes = (kind: string) => vi.waitFor(() => expect(stopState().kind).toBe(kind));

function pressPointer(): void {
  button().dispatchEvent(new PointerEvent("pointerdown", { button: 0, bubbles: true }));
}

function pressKeys(target: EventTarget, more: KeyboardEventInit = {}): void {
  const keys = { code: "KeyE", ctrlKey: true, shiftKey: true, bubbles: true, ...more };
  target.dispatchEvent(new KeyboardEvent("keydown", keys));
}

beforeEach(() => {
  fetched.mockReset().mockImplementation(proof);
});

it("sends one stop per press, when the pointer goes down", async () => {
  pressPointer();
  button().dispatchEvent(new MouseEvent("click", { detail: 1 }));
  await becomes("confirmed");
  expect(fetched).toHaveBeenCalledTimes(1);
  const request = fetched.mock.calls[0]?.[0] as Request;
  expect([request.method, new URL(request.url).pathname]).toEqual(["POST", "/api/stop"]);
  expect(request.credentials).toBe("same-origin");
});

it("stops by keyboard on the button", async () => {
  button().dispatchEvent(new MouseEvent("click", { detail: 0 }));
  await becomes("confirmed");
  expect(fetched).toHaveBeenCalledTimes(1);
});

it("stops on Ctrl+Shift+E inside a text field, once while the keys are held", async () => {
  const field = document.createElement("input");
  document.body.append(field);
  pressKeys(field);
  pressKeys(field, { repeat: true });
  await becomes("confirmed");
  expect(fetched).toHaveBeenCalledTimes(1);
});

it("shows that the stop is not confirmed, and accepts another press", async () => {
  fetched.mockRejectedValue(new TypeError("no network"));
  pressPointer();
  await becomes("unconfirmed");
  expect(fetched).toHaveBeenCalledTimes(3);
  expect(notice().textContent).toMatch(
    /^STOP NOT CONFIRMED: use the stop at the machine\. The service cannot/,
  );
  fetched.mockImplementation(proof);
  pressPointer();
  await becomes("confirmed");
});

it.each(["", "{", "null", "{}"])(
  "sends the stop again after a response without a proof: %j",
  async (body) => {
    fetched.mockImplementationOnce(async () => new Response(body, { status: 200 }));
    pressPointer();
    await becomes("confirmed");
    expect(fetched).toHaveBeenCalledTimes(2);
  },
);

it("shows the service's reason for a refusal", async () => {
  const refusal = { error: { message: "Not signed in." } };
  fetched.mockImplementation(async () => new Response(JSON.stringify(refusal), { status: 401 }));
  pressPointer();
  await becomes("unconfirmed");
  expect(stopState()).toEqual({ ...LOST, reason: "Not signed in." });
});

it("shows the proof while no component of the application shows it", async () => {
  pressPointer();
  await becomes("confirmed");
  expect(notice().textContent).toBe("Zero volts in 1 control step · 1.00 ms (tick 1001)");
  const release = registerDisplay();
  expect(notice().textContent).toBe("");
  release(); // as when a component throws
  expect(notice().textContent).toContain("(tick 1001)");
});

it("shows an unconfirmed stop whatever the application shows, until the motors are off", async () => {
  const release = registerDisplay();
  fetched.mockRejectedValue(new TypeError("no network"));
  pressPointer();
  await becomes("unconfirmed");
  expect(notice().textContent).not.toBe("");
  const link = { alive: true, silent_s: 0, starts: 1, restarting: "", restarting_s: 0 };
  observeState({ mode: "run", tick: 5, stop_proof: null, link });
  expect(stopState().kind).toBe("unconfirmed");
  observeState({ mode: "tripped", tick: 6, stop_proof: null, link });
  expect([stopState().kind, notice().textContent]).toEqual(["idle", ""]);
  release();
});

it("states in its title that it pauses a recording during replay", () => {
  const state = { mode: "off", tick: 5, stop_proof: null } as const;
  const link = { alive: true, silent_s: 0, starts: 1, restarting: "", restarting_s: 0 };
  const position = { title: "run 12", t: 1, tick: 5, duration_s: 2, playing: true, ended: false };
  observeState({ ...state, link, player: { ...position, speed: 1, speed_min: 0.25, speed_max: 4 } });
  expect(button().title).toMatch(/^Pauses playback/);
  observeState({ ...state, link, player: null });
  expect(button().title).toBe(TEXTS.stops);
});

it("shows the current state after a translation has replaced its text", async () => {
  fetched.mockRejectedValue(new TypeError("no network"));
  pressPointer();
  await becomes("unconfirmed");
  const font = document.createElement("font");
  font.textContent = "HALT NICHT BESTÄTIGT";
  notice().replaceChildren(font);
  fetched.mockImplementation(proof);
  pressPointer();
  await becomes("confirmed");
  expect(notice().textContent).toBe("Zero volts in 1 control step · 1.00 ms (tick 1001)");
});
