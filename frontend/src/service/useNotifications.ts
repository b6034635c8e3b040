/** Tells the person what has happened while the page was not looked at, as they have chosen. */

import { useEffect, useEffectEvent } from "react";
import { useLocation } from "wouter";
import { useLiveStore } from "../live/react";
import { answered, api, RequestError } from "../wire/client";
import type { Flight, State } from "../wire/types";
import { ageOf, type Happening, Happenings, recordOf, type Trip, wordsOfRun, wordsOfTrip } from "./log";
import { keepLookedAt, tell } from "./notifications";
import { usePreferences } from "./preferences";

/** A flight record is there once the seconds after its trip are over. */
const LOOKS = 20;
const LOOK_MS = 500;
/** A run whose last samples are being stored is asked for again after so long [ms], one that could not be had later. */
const AGAIN_MS = 500;
const AFTER_FAILURE_MS = 5000;

export function useNotifications(): void {
  const store = useLiveStore();
  const { preferences } = usePreferences();
  const { notify, sound, angles } = preferences;
  const [, go] = useLocation();
  const ways = { notification: notify, sound };
  const wanted = notify || sound;

  const tellTrip = useEffectEvent((trip: Trip) => {
    if (!wanted) return;
    const heard_ms = Date.now() - (ageOf(trip, store.snapshot().state) ?? 0);
    const open = () => {
      const age_ms = ageOf(trip, store.snapshot().state); // of now: a tab that slept has heard of it late
      void openFlight(trip, age_ms === null ? heard_ms : Date.now() - age_ms, go);
    };
    void tell({ ...wordsOfTrip(trip, angles), open }, ways);
  });
  /** Whether there is nothing more to be told of a run. */
  const tellRun = useEffectEvent(async (id: number): Promise<boolean> => {
    if (!wanted) return true;
    const run = await answered(api.GET("/api/runs/{id}", { params: { path: { id } } }));
    if (run.end_state === "running") return false; // its last samples are being stored
    await tell({ ...wordsOfRun(run, angles), open: () => go(`/runs/${id}`) }, ways);
    return true;
  });

  useEffect(keepLookedAt, []);
  useEffect(() => {
    const happenings = new Happenings();
    const over = new Set<number>();
    const notBefore = new Map<number, number>();
    let heard: State | null = null;

    function look(id: number): void {
      if (performance.now() < (notBefore.get(id) ?? 0)) return;
      notBefore.set(id, Number.POSITIVE_INFINITY); // while it is asked for
      const again = (in_ms: number) => notBefore.set(id, performance.now() + in_ms);
      tellRun(id)
        .then((done) => (done ? over.delete(id) : again(AGAIN_MS)))
        .catch((error) => (isFinal(error) ? over.delete(id) : again(AFTER_FAILURE_MS)));
    }

    function hear(): void {
      const { state } = store.snapshot();
      if (state === null || state === heard) return;
      heard = state;
      for (const happening of happenings.heard(state)) take(happening);
      for (const id of over) look(id);
    }

    function take(happening: Happening): void {
      if (happening.kind === "trip") tellTrip(happening);
      else over.add(happening.run);
    }

    hear();
    return store.subscribe(hear);
  }, [store]);
}

/** Whether asking again would be answered the same: it is not there, or not for this person. */
function isFinal(error: unknown): boolean {
  return error instanceof RequestError && error.status >= 400 && error.status < 500 && error.status !== 429;
}

/** Flight records, and by how much the service's clock is ahead of this page's [ms]. */
async function flightsNow(): Promise<{ flights: readonly Flight[]; ahead_ms: number }> {
  const from_ms = Date.now();
  const request = api.GET("/api/flights");
  const { flights } = await answered(request);
  const date = Date.parse((await request).response.headers.get("Date") ?? "");
  // of a header in whole seconds, and at some time of the way there and back
  const ahead_ms = Number.isNaN(date) ? 0 : date + 500 - (from_ms + Date.now()) / 2;
  return { flights, ahead_ms };
}

/** Leads to the record of a trip at `at_ms` by the page's clock; to the log where there is none. */
async function openFlight(trip: Trip, at_ms: number, go: (path: string) => void): Promise<void> {
  for (let look = 0; look < LOOKS; look++) {
    try {
      const { flights, ahead_ms } = await flightsNow();
      const flight = recordOf(flights, trip, at_ms + ahead_ms);
      if (flight !== undefined) {
        go(`/flights/${flight.id}`);
        return;
      }
    } catch (error) {
      if (isFinal(error)) break;
    }
    await new Promise((later) => setTimeout(later, LOOK_MS));
  }
  go("/log");
}
