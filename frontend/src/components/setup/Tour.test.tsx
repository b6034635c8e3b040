import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { act, cleanup, fireEvent, render, screen, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";

// the REST client stores fetch when it is created
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  return replacement;
});

import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import { preferencesQuery } from "../../service/api/preferences";
import { sessionQuery } from "../../service/api/session";
import { NameQuestion } from "../NameQuestion";
import { Tour } from "./Tour";

const NEW = { toured: false } as Awaited<ReturnType<NonNullable<typeof preferencesQuery.queryFn>>>;
let queries: QueryClient;

beforeEach(() => {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  fetched.mockReset().mockImplementation(async () => Response.json({}));
  queries = new QueryClient({ defaultOptions: { queries: { staleTime: Number.POSITIVE_INFINITY } } });
  queries.setQueryData(preferencesQuery.queryKey, NEW);
  queries.setQueryData(sessionQuery.queryKey, { name: "operator", role: "operator" } as never);
  render(
    <MantineProvider>
      <QueryClientProvider client={queries}>
        <LiveProvider store={new LiveStore(0)}>
          <NameQuestion wanted={false} onDone={() => undefined} />
          <Tour />
        </LiveProvider>
      </QueryClientProvider>
    </MantineProvider>,
  );
});
afterEach(cleanup);

const tour = () => screen.queryByRole("region", { name: "Tour" });
const isToured = () => queries.getQueryData(preferencesQuery.queryKey)?.toured;

it("remains ended when a person takes a name, and restarts on request", async () => {
  expect(tour()).not.toBeNull();
  fireEvent.click(screen.getByRole("button", { name: "Skip tour" }));
  await waitFor(() => expect(tour()).toBeNull());

  act(() => {
    queries.setQueryData(sessionQuery.queryKey, { name: "Mara Stein", role: "operator" } as never);
    queries.setQueryData(preferencesQuery.queryKey, NEW);
  });
  expect(tour()).toBeNull();
  await waitFor(() => expect(isToured()).toBe(true));

  act(() => void queries.setQueryData(preferencesQuery.queryKey, NEW));
  await waitFor(() => expect(tour()).not.toBeNull());
});

it("precedes the question for a name, one bar at a time", async () => {
  const question = () => screen.queryByRole("form", { name: "Your name" });
  act(() => {
    const session = { name: "operator", role: "operator", asks_name: true };
    queries.setQueryData(sessionQuery.queryKey, session as never);
  });
  expect([tour() === null, question() === null]).toEqual([false, true]);
  fireEvent.click(screen.getByRole("button", { name: "Skip tour" }));
  await waitFor(() => expect([tour() === null, question() === null]).toEqual([true, false]));
});
