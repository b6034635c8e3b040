/** Moves between modes: only the legal ones can be pressed, the others say why not. */

import { Button, Tooltip } from "@mantine/core";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { usePages } from "../../components/Navigation";
import { Refusal } from "../../components/Refusal";
import { useLive } from "../../live/react";
import { capital, heading } from "../../samples/words";
import { useSetMode } from "../../service/commands";
import { useNoControl } from "../../service/useNoControl";
import type { Mode, State } from "../../wire/types";
import styles from "./Operate.module.css";

const MOVES: readonly { mode: Mode; name: string; meaning: string }[] = [
  { mode: "pretension", name: "Pretension", meaning: "Wind both tendons up to 10 N and hold them." },
  { mode: "run", name: "Run", meaning: "Close the loops of position and stiffness; the run is recorded." },
  {
    mode: "compliance",
    name: "Compliance",
    meaning:
      "Open the joint loop: q_ref acts through geometry alone, a push moves the joint. Stiffness stays controlled.",
  },
  {
    mode: "stopping",
    name: "Soft stop",
    meaning: "Bring the joint to rest under tension, then to zero volts.",
  },
  { mode: "off", name: "Off", meaning: "Zero volts; the tendons go slack." },
];

/** Words are shown beside the card: nothing covers its title, or a button that stops. */
const COLUMNS = 3;
const COLUMN_PX = 102;
const BESIDE_CARD_PX = 24;

export function ModeCard() {
  const state = useLive((live) => live.state);
  const setMode = useSetMode();
  const noControl = useNoControl();
  return (
    <Card title="Mode">
      {/* biome-ignore lint/a11y/useSemanticElements: buttons that act at once are no form */}
      <div className={styles.moves} role="group" aria-label="Change mode">
        {MOVES.map(({ mode, name, meaning }, index) => {
          const reason = noControl ?? whyNot(state, mode);
          return (
            <Tooltip
              key={mode}
              label={reason ?? meaning}
              position="left"
              offset={BESIDE_CARD_PX + (index % COLUMNS) * COLUMN_PX}
              openDelay={300}
              middlewares={{ flip: false, shift: true }}
            >
              <Button
                px={4}
                variant={state?.mode === mode ? "filled" : "default"}
                aria-pressed={state?.mode === mode}
                aria-disabled={reason !== null}
                data-disabled={reason !== null && state?.mode !== mode ? true : undefined}
                loading={setMode.isPending && setMode.variables === mode}
                onClick={(event) => {
                  if (reason === null) setMode.mutate(mode);
                  else event.preventDefault();
                }}
              >
                {name}
              </Button>
            </Tooltip>
          );
        })}
      </div>
      {isUnready(state) && noControl === null ? (
        <Unready why={state.unready} />
      ) : (
        <Refusal error={setMode.error} text={noControl} />
      )}
    </Card>
  );
}

/** In the place of a refusal: nothing can be asked for that could be refused. */
function Unready({ why }: { why: string }) {
  const offered = usePages().some(({ path }) => path === "/bring-up");
  return (
    <p className={styles.unready}>
      No pretension yet. {capital(why)}. {offered && <Link href="/bring-up">Go to Bring-up</Link>}
    </p>
  );
}

/** Whether something has to come before pretension on what is driven. */
export function isUnready(state: State | null): state is State {
  return state?.mode === "off" && state.unready !== "";
}

/** Why a mode cannot be entered now; null when it can. */
export function whyNot(state: State | null, mode: Mode): string | null {
  if (state === null) return "The state of the loop is not known yet.";
  if (state.mode === mode) return `The mode is ${heading(mode)} already.`;
  if (state.legal_modes.includes(mode)) return null;
  if (state.mode === "tripped") return "A fault is latched: press Reset first.";
  if (state.mode === "stopping") return "A soft stop is under way; it ends in off by itself.";
  if (isUnready(state) && mode !== "stopping") return `${capital(state.unready)}.`;
  if (state.mode === "off" && mode !== "stopping") return "Tendons are slack: start Pretension first.";
  if (state.mode === "pretension" && !state.pretension_done) return "Pretension is not reached yet.";
  if (state.task?.phase === "paused") return "An order is paused in pretension: go on, or stop softly.";
  const legal = MOVES.filter((move) => state.legal_modes.includes(move.mode)).map(({ name }) => name);
  return `Not possible from ${heading(state.mode)}. Possible now: ${legal.join(", ") || "nothing but STOP"}.`;
}
