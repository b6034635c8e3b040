import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { act, cleanup, fireEvent, render, screen, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";

// the REST client captures fetch when it is created
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  vi.stubGlobal(
    "ResizeObserver",
    class {
      observe() {}
      unobserve() {}
      disconnect() {}
    },
  );
  return replacement;
});

import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import { fillText } from "../../samples/texts";
import { TEXTS as SERVICE } from "../../service/texts";
import type { PlayerPosition, State } from "../../wire/types";
import { PlayerCard } from "./PlayerCard";
import { TEXTS } from "./texts";

const PLAYER: PlayerPosition = {
  title: "run 12",
  t: 12,
  tick: 12_000,
  duration_s: 102,
  playing: false,
  ended: false,
  speed: 1,
  speed_min: 0.25,
  speed_max: 4,
};
const MARKS = [
  { t: 5, kind: "mode", text: "pretension → experiment", who: "" },
  { t: 40.5, kind: "references", text: "q_ref 1.0472\u202frad, S_ref 10\u202fN·m/rad", who: "" },
];

let role: string;
let holder: unknown;

function open(part: Partial<PlayerPosition> = {}): LiveStore {
  const store = new LiveStore(0);
  report(store, part);
  render(
    <MantineProvider>
      <QueryClientProvider client={new QueryClient()}>
        <LiveProvider store={store}>
          <PlayerCard />
        </LiveProvider>
      </QueryClientProvider>
    </MantineProvider>,
  );
  return store;
}

function report(store: LiveStore, part: Partial<PlayerPosition>): void {
  store.setState({ player: { ...PLAYER, ...part }, holder, link: { alive: true } } as unknown as State);
}

async function ordered(): Promise<unknown[]> {
  const puts = fetched.mock.calls
    .map(([request]) => request)
    .filter(({ url, method }) => new URL(url).pathname === "/api/player" && method === "PUT");
  return Promise.all(puts.map((request) => request.clone().json()));
}

const position = () => screen.getByRole("status", { name: TEXTS.playbackPosition }).textContent;

beforeEach(() => {
  role = "operator";
  holder = null;
  fetched.mockReset().mockImplementation(async ({ url, method }) => {
    const path = new URL(url).pathname;
    if (path === "/api/control") return Response.json({ epoch: 1, page: "k".repeat(16), name: "Ana" });
    if (path === "/api/session") return Response.json({ role });
    if (path === "/api/player" && method === "GET")
      return Response.json({ title: "run 12", run: 12, duration_s: 102, marks: MARKS });
    return new Response(null, { status: 204 });
  });
});
afterEach(() => {
  vi.useRealTimers();
  cleanup();
});

it("shows position and duration, and sends play, pause and speed", async () => {
  const store = open();
  expect(position()).toBe("0:12.0 of 1:42.0");
  fireEvent.click(screen.getByRole("button", { name: TEXTS.play }));
  await waitFor(async () => expect(await ordered()).toEqual([{ playing: true }]));
  act(() => report(store, { playing: true }));
  fireEvent.click(screen.getByRole("button", { name: TEXTS.pause }));
  fireEvent.change(screen.getByRole("combobox", { name: TEXTS.playbackSpeed }), {
    target: { value: "0.25" },
  });
  await waitFor(async () =>
    expect(await ordered()).toEqual([{ playing: true }, { playing: false }, { speed: 0.25 }]),
  );
});

it("sends the time of a mark and an entered time", async () => {
  open();
  fireEvent.click(await screen.findByRole("button", { name: /0:40\.5/ }));
  const box = screen.getByRole("textbox", { name: TEXTS.goToTime });
  fireEvent.change(box, { target: { value: "61.25" } });
  fireEvent.keyDown(box, { key: "Enter" });
  fireEvent.click(screen.getByRole("button", { name: TEXTS.go }));
  await waitFor(async () => expect(await ordered()).toEqual([{ t: 40.5 }, { t: 61.25 }]));
});

it("advances between two reports of the service at the set speed, up to the end", () => {
  vi.useFakeTimers();
  open({ playing: true, speed: 4 });
  act(() => void vi.advanceTimersByTime(1000));
  expect(position()).toBe("0:16.0 of 1:42.0");
  act(() => void vi.advanceTimersByTime(60_000));
  expect(position()).toBe("1:42.0 of 1:42.0");
});

it("highlights the last mark that was passed, in the person's angle unit", async () => {
  open({ t: 41 });
  const passed = await screen.findByRole("button", { name: /q_ref 60°/ });
  expect(passed.closest("li")?.getAttribute("aria-current")).toBe("true");
});

it("disables the controls for a viewer", async () => {
  role = "viewer";
  open();
  await waitFor(() =>
    expect(screen.getByRole("button", { name: TEXTS.play }).hasAttribute("disabled")).toBe(true),
  );
  expect(screen.queryByRole("button", { name: TEXTS.go })).toBeNull();
  expect((await screen.findByRole("button", { name: /0:40\.5/ })).hasAttribute("disabled")).toBe(true);
});

it("is disabled with the reason while another person holds control", async () => {
  holder = { name: "Mara", page: true, lost: false, epoch: 3 };
  open();
  expect(screen.getByRole("status", { name: "Refusal" }).textContent).toContain(
    fillText(SERVICE.hasControl, { name: "Mara" }),
  );
  for (const name of [TEXTS.play, TEXTS.go]) {
    expect(screen.getByRole("button", { name }).hasAttribute("disabled")).toBe(true);
  }
});
