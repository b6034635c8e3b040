/** The mode that has to come before what is refused at present, one press away. */

import { Button } from "@mantine/core";
import { useLive } from "../../live/react";
import { useSetMode } from "../../service/commands";
import { useMayCommand } from "../../service/useMayCommand";
import { useNoControl } from "../../service/useNoControl";
import type { State } from "../../wire/types";

/** What needs a mode: a run needs tension, a change of parameters needs the motors off. */
export type Need = "start" | "off";

const NAMES = { pretension: "Pretension", stopping: "Soft stop" } as const;

export function NextMode({ need }: { need: Need }) {
  const mode = useLive((live) => nextMode(live.state, need));
  const noControl = useNoControl();
  const may = useMayCommand();
  const set = useSetMode();
  if (mode === null || noControl !== null || may === false) return null;
  return (
    <>
      <Button
        size="compact-xs"
        ml={6}
        variant="default"
        loading={set.isPending}
        onClick={() => set.mutate(mode)}
      >
        {NAMES[mode]}
      </Button>
      {set.error !== null && <span> {set.error.message}</span>}
    </>
  );
}

/** The mode to go to first; null where none helps at present. Pure. */
export function nextMode(state: State | null, need: Need): keyof typeof NAMES | null {
  if (state === null || state.task !== null || state.trial !== null) return null;
  const wanted = need === "start" ? "pretension" : "stopping";
  if ((state.mode === "off") !== (need === "start")) return null;
  return state.legal_modes.includes(wanted) ? wanted : null;
}
