/** Takes control of the actuator for this page, from whoever holds it. */

import { Button, type ButtonProps } from "@mantine/core";
import { useMutation } from "@tanstack/react-query";
import { useLive } from "../live/react";
import { useErrorLifetime } from "../service/control";
import { answeredBy } from "../wire/client";
import { takeControl } from "../wire/control";

export function TakeControl(look: Pick<ButtonProps, "variant" | "color">) {
  const holder = useLive((live) => live.state?.holder?.name ?? null);
  const take = useMutation({ mutationFn: () => answeredBy(takeControl(true)) });
  const refused = useErrorLifetime(take.error);
  return (
    <>
      <Button
        size="compact-xs"
        variant="default"
        {...look}
        loading={take.isPending}
        title={holder === null ? undefined : `${holder} loses control`}
        onClick={() => take.mutate()}
      >
        Take control
      </Button>
      {refused !== null && <span> {refused.message}</span>}
    </>
  );
}
