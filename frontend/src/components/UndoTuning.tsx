/** One step back of what is in force, whatever part of it was changed; pressed again, it is done again. */

import { Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useLive } from "../live/react";
import type { useUndo } from "../service/commands";
import { banksQuery } from "../service/queries";
import { tuningInWords } from "../service/tuningWords";

export function UndoTuning({ undo, size }: { undo: ReturnType<typeof useUndo>; size?: "compact-xs" }) {
  const earlier = useLive((live) => live.state?.earlier ?? null);
  const busy = useLive((live) => live.state?.trial != null || live.state?.own_tuning != null);
  // what was learned of pushes may be gone by now
  const unlearned = useLive(
    (live) => (live.state?.earlier?.k_ext ?? 0) > 0 && live.state?.touch.learned.length === 0,
  );
  const { data: banks = [] } = useQuery(banksQuery);
  const words = earlier === null ? "" : tuningInWords({ ...earlier, bank: earlier.bank?.id ?? 0 }, banks);
  return (
    <Button
      variant="default"
      {...(size === undefined ? {} : { size })}
      disabled={earlier === null || busy || unlearned}
      loading={undo.isPending}
      title={earlier === null ? "Nothing was changed yet" : `Back to ${words}`}
      onClick={() => undo.mutate()}
    >
      Undo change
    </Button>
  );
}
