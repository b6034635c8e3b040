import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { act, cleanup, fireEvent, render, screen, waitFor } from "@testing-library/react";
import { afterEach, expect, it, vi } from "vitest";
import { preferencesQuery } from "../service/api/preferences";
import { setVisibility, shown, tones, useBrowser } from "../service/notifications/browser.fixture";
import { TEXTS as SERVICE } from "../service/texts";
import type { Preferences } from "../wire/types";
import { NotificationMenu } from "./Header";

const changes: Partial<Preferences>[] = [];

afterEach(() => {
  cleanup();
  changes.length = 0;
  vi.restoreAllMocks();
  vi.unstubAllGlobals();
});

async function opened(before: Partial<Preferences> = {}) {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  vi.stubGlobal(
    "ResizeObserver",
    class {
      observe() {}
      unobserve() {}
      disconnect() {}
    },
  );
  vi.stubGlobal("fetch", async (request: Request) => {
    const body = await request.json();
    changes.push(body);
    return Response.json(body);
  });
  const queries = new QueryClient();
  queries.setQueryData(preferencesQuery.queryKey, { notify: false, sound: false, ...before } as Preferences);
  render(
    <QueryClientProvider client={queries}>
      <MantineProvider env="test">
        <NotificationMenu />
      </MantineProvider>
    </QueryClientProvider>,
  );
  await act(async () => fireEvent.click(screen.getByRole("button", { name: "Notifications" })));
}

const item = (name: string) => screen.getByRole("menuitemcheckbox", { name });
const press = (name: string) => act(async () => fireEvent.click(item(name)));

it("is off until a person switches it on, and asks the browser only on that click", async () => {
  const { asked } = useBrowser("default", "granted");
  await opened();
  expect(item("Notifications").getAttribute("aria-checked")).toBe("false");
  expect(item("Sound").getAttribute("aria-checked")).toBe("false");
  expect(asked).not.toHaveBeenCalled();
  expect(screen.queryByRole("status", { name: "Notifications on this page" })).toBeNull();
  await press("Notifications");
  expect(asked).toHaveBeenCalledTimes(1);
  await waitFor(() => expect(changes.map(({ notify, sound }) => [notify, sound])).toEqual([[true, false]]));
  expect(item("Notifications").getAttribute("aria-checked")).toBe("true");
  await press("Notifications");
  await waitFor(() => expect(changes.map(({ notify }) => notify)).toEqual([true, false]));
  expect([asked.mock.calls.length, shown.length]).toEqual([1, 0]);
});

it("states the remedy if the person or the browser refuses, and remains off", async () => {
  useBrowser("default", "denied");
  await opened();
  await press("Notifications");
  expect(screen.getByRole("status", { name: "Notifications on this page" }).textContent).toContain(
    SERVICE.denied,
  );
  expect(item("Notifications").getAttribute("aria-checked")).toBe("false");
  expect(changes).toEqual([]);
});

it("is off in a browser without permission, even if it is on in another one", async () => {
  useBrowser("default", "granted");
  await opened({ notify: true });
  expect(item("Notifications").getAttribute("aria-checked")).toBe("false");
  expect(screen.getByRole("status", { name: "Notifications on this page" }).textContent).toContain(
    SERVICE.notAllowedYet,
  );
});

it("states the remedy if the person does not answer the browser's question", async () => {
  useBrowser("default", "default");
  await opened();
  await press("Notifications");
  expect(screen.getByRole("status", { name: "Notifications on this page" }).textContent).toBe(
    SERVICE.notAllowedYet,
  );
  expect(changes).toEqual([]);
});

it("states that a browser has no notifications", async () => {
  useBrowser("granted");
  vi.stubGlobal("isSecureContext", false);
  await opened();
  expect(screen.getByRole("status", { name: "Notifications on this page" }).textContent).toBe(
    SERVICE.insecure,
  );
});

it("has a sound, which it plays when a person switches it on", async () => {
  const { asked } = useBrowser("default");
  setVisibility(true);
  await opened();
  await press("Sound");
  expect(tones).toHaveLength(1);
  await waitFor(() => expect(changes.map(({ notify, sound }) => [notify, sound])).toEqual([[false, true]]));
  await press("Sound");
  expect([tones.length, asked.mock.calls.length]).toEqual([1, 0]);
});
