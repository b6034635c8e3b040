import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { act, cleanup, fireEvent, render, screen, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";

// the REST client takes hold of fetch when it is made
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  return replacement;
});

import { preferencesQuery } from "../../service/preferences";
import { sessionQuery } from "../../service/queries";
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
        <Tour />
      </QueryClientProvider>
    </MantineProvider>,
  );
});
afterEach(cleanup);

const tour = () => screen.queryByRole("region", { name: "Tour" });
const isToured = () => queries.getQueryData(preferencesQuery.queryKey)?.toured;

it("stays ended for whoever takes a name after it, and begins anew where it is asked for", async () => {
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
