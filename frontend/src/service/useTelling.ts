/** Tells the person what has happened while the page was not looked at, as they have chosen. */

import { useEffect, useEffectEvent } from "react";
import { useLocation } from "wouter";
import { useLiveStore } from "../live/react";
import { answered, api } from "../wire/client";
import type { Flight, State } from "../wire/types";
import { type Happening, Happenings, type Trip } from "./happenings";
import { keepLookedAt, tell } from "./notifications";
import { usePreferences } from "./preferences";
import { flightOf } from "./system";
import { wordsOfRun, wordsOfTrip } from "./toldWords";

/** A flight record is there once the seconds after its trip are over. */
const LOOKS = 20;
const LOOK_MS = 500;

export function useTelling(): void {
  const store = useLiveStore();
  const { preferences } = usePreferences();
  const { notify, sound, angles } = preferences;
  const [, go] = useLocation();
  const ways = { notification: notify, sound };
  const wanted = notify || sound;

  const tellTrip = useEffectEvent((trip: Trip) => {
    if (!wanted) return;
    // its own record is not there yet: by that it is told from one of an earlier loop, whose ticks were the same
    const earlier = flightsNow().then((flights) => Math.max(0, ...flights.map(({ id }) => id)));
    const open = () => void earlier.then((id) => openFlight(trip, id, go));
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
    const asking = new Set<number>();
    let heard: State | null = null;

    function look(id: number): void {
      if (asking.has(id)) return;
      asking.add(id);
      tellRun(id)
        .then((done) => done && over.delete(id))
        .catch(() => undefined) // asked again with the next state
        .finally(() => asking.delete(id));
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

async function flightsNow(): Promise<Flight[]> {
  return (await answered(api.GET("/api/flights")).catch(() => ({ flights: [] }))).flights;
}

async function openFlight({ fault }: Trip, earlier: number, go: (path: string) => void): Promise<void> {
  for (let look = 0; look < LOOKS; look++) {
    const later = (await flightsNow()).filter(({ id }) => id > earlier);
    const flight = later.find((one) => flightOf([one], fault) !== undefined);
    if (flight !== undefined) {
      go(`/flights/${flight.id}`);
      return;
    }
    await new Promise((later) => setTimeout(later, LOOK_MS));
  }
  go("/log");
}
