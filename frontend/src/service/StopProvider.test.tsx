import { cleanup, fireEvent, render, screen, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";

// the REST client takes hold of fetch when it is made
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  return replacement;
});

import { StopButton } from "../components/StopButton";
import { StopProvider, useStop } from "./StopProvider";

const PROOF = { arrived_tick: 1000, zero_tick: 1001, milliseconds: 1 };

async function proof(): Promise<Response> {
  return new Response(JSON.stringify(PROOF), { status: 200 });
}

function Outcome() {
  return <output>{useStop().state.kind}</output>;
}

function open(): void {
  render(
    <StopProvider>
      <StopButton />
      <input aria-label="note" />
      <Outcome />
    </StopProvider>,
  );
}

const shows = (text: string) => waitFor(() => expect(screen.getByRole("status").textContent).toBe(text));

beforeEach(() => {
  fetched.mockReset().mockImplementation(proof);
});

afterEach(cleanup);

it("stops when the button goes down, once for press and release together", async () => {
  open();
  const button = screen.getByRole("button", { name: "STOP" });
  fireEvent.pointerDown(button, { button: 0 });
  fireEvent.click(button, { detail: 1 });
  await shows("confirmed");
  expect(fetched).toHaveBeenCalledTimes(1);
  const request = fetched.mock.calls[0]?.[0] as Request;
  expect([request.method, new URL(request.url).pathname]).toEqual(["POST", "/api/stop"]);
});

it("stops by keyboard on the button", async () => {
  open();
  fireEvent.click(screen.getByRole("button", { name: "STOP" }), { detail: 0 });
  await shows("confirmed");
  expect(fetched).toHaveBeenCalledTimes(1);
});

it("stops by Ctrl+Shift+E inside a text field, once however long the keys are held", async () => {
  open();
  const keys = { code: "KeyE", ctrlKey: true, shiftKey: true };
  fireEvent.keyDown(screen.getByRole("textbox"), keys);
  fireEvent.keyDown(screen.getByRole("textbox"), { ...keys, repeat: true });
  await shows("confirmed");
  expect(fetched).toHaveBeenCalledTimes(1);
});

it("says that it could not confirm, and still lets STOP be pressed again", async () => {
  fetched.mockRejectedValue(new TypeError("no network"));
  open();
  fireEvent.pointerDown(screen.getByRole("button", { name: "STOP" }), { button: 0 });
  await shows("unconfirmed");
  fetched.mockImplementation(proof);
  fireEvent.pointerDown(screen.getByRole("button", { name: "STOP" }), { button: 0 });
  await shows("confirmed");
});
