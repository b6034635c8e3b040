/** Shown in place of everything else where the browser keeps no cookies: nobody can be signed in there. */

import { Box, Paper, Text, Title } from "@mantine/core";

export function CookiesBlockedPage() {
  const host = globalThis.location.host;
  return (
    <Box pt="12vh" px="xs">
      <Paper component="main" withBorder maw={480} mx="auto" p="xl">
        <Title order={1} size="h3" mb="md">
          Cookies are blocked
        </Title>
        <Text role="alert" style={{ overflowWrap: "anywhere" }}>
          This browser blocks cookies for {host}, so nobody can be signed in and STOP does not work here:
          allow cookies for {host}, load this page again, and until then use the stop at the machine.
        </Text>
      </Paper>
    </Box>
  );
}
