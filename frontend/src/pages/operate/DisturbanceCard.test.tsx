import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { act, cleanup, fireEvent, render, screen, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";

// the REST client captures fetch when it is created
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  return replacement;
});

import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import type { State } from "../../wire/types";
import { DisturbanceCard } from "./DisturbanceCard";
import { TEXTS } from "./texts";

let store: LiveStore;

function open(mode: State["mode"], F_push_max: number): void {
  store = new LiveStore(0);
  store.setState({ mode, limits: { F_push_max }, link: { alive: true }, fault: null } as unknown as State);
  render(
    <MantineProvider>
      <QueryClientProvider client={new QueryClient()}>
        <LiveProvider store={store}>
          <DisturbanceCard />
        </LiveProvider>
      </QueryClientProvider>
    </MantineProvider>,
  );
}

async function pushed(): Promise<unknown[]> {
  const posts = fetched.mock.calls
    .map(([request]) => request)
    .filter(({ url }) => new URL(url).pathname === "/api/push");
  return Promise.all(posts.map((request) => request.clone().json()));
}

beforeEach(() => {
  fetched.mockReset().mockImplementation(async ({ url }) => {
    const path = new URL(url).pathname;
    return Response.json(path === "/api/control" ? { epoch: 1, page: "k".repeat(16), name: "Ana" } : {});
  });
});
afterEach(() => {
  cleanup();
  localStorage.clear();
});

const button = (name: string) => screen.getByRole("button", { name });

it("applies a push with the values of the boxes, and releases it", async () => {
  open("compliance", 30);
  const force = screen.getByRole("textbox", { name: TEXTS.pushForce });
  fireEvent.change(force, { target: { value: "-12.5" } });
  fireEvent.blur(force);
  fireEvent.click(button(TEXTS.applyPush));
  await waitFor(async () => expect(await pushed()).toEqual([{ F_push: -12.5, duration_s: 2 }]));
  fireEvent.click(button(TEXTS.release));
  await waitFor(async () => expect((await pushed())[1]).toEqual({ F_push: 0, duration_s: 0 }));
});

it("sends no push with a value that is not a number", async () => {
  open("run", 30);
  const force = screen.getByRole("textbox", { name: TEXTS.pushForce });
  fireEvent.change(force, { target: { value: "5-3" } });
  fireEvent.blur(force);
  fireEvent.click(button(TEXTS.applyPush));
  await act(() => new Promise((resolve) => setTimeout(resolve, 20)));
  expect(await pushed()).toEqual([]);
  expect(screen.getByRole("status", { name: "Refusal" }).textContent).toContain(
    "Not sent. Press Esc to restore.",
  );
});

it("is absent on a plant without pushes, and names the modes that accept a push", async () => {
  open("run", 0);
  expect(screen.queryByRole("button")).toBeNull();
  cleanup();
  open("pretension", 30);
  expect(button(TEXTS.applyPush).getAttribute("aria-disabled")).toBe("true");
  fireEvent.click(button(TEXTS.applyPush));
  await act(() => new Promise((resolve) => setTimeout(resolve, 20)));
  expect(await pushed()).toEqual([]);
  expect(screen.getByRole("status", { name: "Refusal" }).textContent).toContain(TEXTS.pushNeedsMode);
});
