/** Tour for new people in a separate line, so that it covers nothing; it outlines the current element. */

import { Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useEffect, useState } from "react";
import { useLocation } from "wouter";
import { fillText } from "../../samples/texts";
import { usePreferences } from "../../service/api/preferences";
import { sessionQuery } from "../../service/api/session";
import { TEXTS } from "../texts";
import styles from "./Tour.module.css";

const STEPS = [
  {
    target: "STOP",
    text: TEXTS.tourStop,
  },
  {
    target: "Change mode",
    text: TEXTS.tourMode,
  },
  {
    target: "Charts",
    text: TEXTS.tourCharts,
  },
  {
    target: "Reachable map",
    text: TEXTS.tourMap,
  },
  {
    target: "Tuning",
    text: TEXTS.tourTuning,
  },
  {
    target: TEXTS.setup,
    text: TEXTS.tourSetup,
  },
] as const;

export function Tour() {
  const { preferences, known, change } = usePreferences();
  const [at, setAt] = useState(0);
  const [, go] = useLocation();
  const name = useQuery(sessionQuery).data?.name;
  // A person who takes a name after the tour has new preferences, but has seen the tour.
  const [endedAs, setEndedAs] = useState<string>();
  const isRenamed = endedAs !== undefined && name !== undefined && name !== endedAs;
  const shown = known && !preferences.toured && !isRenamed;
  const step = STEPS[at] ?? STEPS[0];

  useEffect(() => {
    if (!shown) return;
    const target = document.querySelector<HTMLElement>(`[aria-label="${step.target}"]`);
    if (target === null) return;
    target.dataset.toured = "true";
    return () => {
      delete target.dataset.toured;
    };
  }, [shown, step]);

  useEffect(() => {
    if (!isRenamed || !known || preferences.toured) return;
    change({ toured: true });
    setEndedAs(name);
  }, [isRenamed, known, preferences.toured, name, change]);

  if (!shown) return null;
  const last = at === STEPS.length - 1;
  const end = () => {
    setAt(0);
    setEndedAs(name);
    change({ toured: true });
  };
  return (
    <section className={styles.tour} aria-label={TEXTS.tour}>
      <span className={styles.count}>{fillText(TEXTS.tourCount, { step: at + 1, total: STEPS.length })}</span>
      <output className={styles.text}>{step.text}</output>
      <Button variant="default" size="compact-sm" disabled={at === 0} onClick={() => setAt(at - 1)}>
        {TEXTS.tourBack}
      </Button>
      <Button
        size="compact-sm"
        onClick={() => {
          if (last) end();
          else {
            go("/operate");
            setAt(at + 1);
          }
        }}
      >
        {last ? TEXTS.tourDone : TEXTS.tourNext}
      </Button>
      {!last && (
        <Button variant="subtle" size="compact-sm" onClick={end}>
          {TEXTS.tourSkip}
        </Button>
      )}
    </section>
  );
}
