/** Takes control of the actuator for this page, from whoever holds it. */

import { Button } from "@mantine/core";
import { useMutation } from "@tanstack/react-query";
import { useLive } from "../live/react";
import { useStanding } from "../service/useStanding";
import { answeredBy } from "../wire/client";
import { takeControl } from "../wire/control";

export function TakeControl() {
  const holder = useLive((live) => live.state?.holder?.name ?? null);
  const take = useMutation({ mutationFn: () => answeredBy(takeControl(true)) });
  const refused = useStanding(take.error);
  return (
    <Button
      size="compact-xs"
      variant="default"
      loading={take.isPending}
      title={refused?.message ?? (holder === null ? undefined : `${holder} loses control`)}
      onClick={() => take.mutate()}
    >
      Take control
    </Button>
  );
}
