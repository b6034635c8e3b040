/** Pages for who is not signed in: the sign-in, and the reason why it cannot work without cookies. */

import { Alert, Box, Button, Paper, PasswordInput, Stack, Text, TextInput, Title } from "@mantine/core";
import { type FormEvent, useState } from "react";
import { useSignIn } from "../service/api/session";

/** Shown in place of everything else where the browser keeps no cookies: nobody can be signed in there. */

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

/** Shown when the page has no session: a token opens it. STOP is here too: a session that lapsed is good for it. */

export function SignInPage() {
  const [token, setToken] = useState("");
  const [name, setName] = useState("");
  const signIn = useSignIn();

  function submit(event: FormEvent): void {
    event.preventDefault();
    signIn.mutate({ token: token.trim(), name: name.trim() });
  }

  return (
    <Box pt="12vh" px="xs">
      <Paper component="main" withBorder maw={420} mx="auto" p="xl">
        <form onSubmit={submit}>
          <Stack gap="md">
            <Title order={1} size="h3">
              Sign in to Sinew
            </Title>
            <Text size="sm" c="dimmed">
              Open the sign-in link that the service printed when it started, or paste its token here. The
              token is also kept in the data folder.
            </Text>
            <Text size="sm">
              STOP works here as long as this browser was signed in and did not sign out. If it is not
              confirmed, use the stop at the machine.
            </Text>
            <PasswordInput
              label="Token"
              required
              withAsterisk={false}
              autoComplete="current-password"
              value={token}
              onChange={(event) => setToken(event.currentTarget.value)}
            />
            <TextInput
              label="Your name"
              description="shown to the others at this machine"
              value={name}
              onChange={(event) => setName(event.currentTarget.value)}
            />
            {signIn.error && <Alert color="yellow">{signIn.error.message}</Alert>}
            <Button type="submit" size="sm" loading={signIn.isPending} disabled={token.trim() === ""}>
              Sign in
            </Button>
          </Stack>
        </form>
      </Paper>
    </Box>
  );
}
